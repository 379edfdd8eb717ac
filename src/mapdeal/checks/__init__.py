"""What is wrong with maps and parameter files."""
