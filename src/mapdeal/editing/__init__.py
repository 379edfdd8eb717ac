"""Changes to parts of a grid: shapes drawn, regions reset, windows, other origins."""
