"""Algorithms on bare arrays, in cells: no units, no files, no types but arrays."""
