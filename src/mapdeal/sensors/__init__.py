"""Files of clouds, scans, poses and points."""
