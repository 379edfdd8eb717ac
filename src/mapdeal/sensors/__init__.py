"""Readers of clouds, scans, poses and points."""
