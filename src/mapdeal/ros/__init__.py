"""Parameter files of robots, and what they mean."""
