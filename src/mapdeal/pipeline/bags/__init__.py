"""Commands on bags: reading grids, scans and clouds, and the poses of sensors."""
