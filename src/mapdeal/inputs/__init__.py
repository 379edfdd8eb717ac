"""What files are, and which files names stand for."""
