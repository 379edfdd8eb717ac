"""A page about runs, maps and results."""
