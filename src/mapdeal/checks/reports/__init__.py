"""Findings of lint, in the formats that people and machines read."""
