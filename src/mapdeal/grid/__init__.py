"""Frozen grids and their geometry: where a cell lies, what its value means."""
