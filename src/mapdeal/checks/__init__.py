"""Checks of maps, each with a name and a severity: what ``mapdeal lint`` says."""
