"""What a robot's parameter files mean: its shape, and the layers of its costmap."""
