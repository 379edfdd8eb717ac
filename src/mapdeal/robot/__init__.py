"""A robot's parameter files: its shape, and the layers of its costmap."""
