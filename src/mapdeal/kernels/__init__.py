"""Algorithms on bare arrays, in cells; units and files belong to other packages."""
