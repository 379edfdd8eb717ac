"""Point clouds: PCD, PLY, text, and numpy's arrays, each read some points at a time."""
