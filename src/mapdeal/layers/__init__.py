"""Costmap layers: one class each, which owns its parameters and its effect on the master grid."""
