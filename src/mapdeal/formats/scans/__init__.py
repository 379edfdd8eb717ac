"""Laser scans with poses: CARMEN logs, text in three files, npz; read some scans at a time."""
