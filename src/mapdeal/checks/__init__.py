"""Checks of maps and parameter files."""
