"""Shapes drawn into grids, regions reset, several maps merged into one."""
