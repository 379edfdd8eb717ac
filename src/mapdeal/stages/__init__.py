"""Stages: functions from frozen grids to new frozen grids."""
