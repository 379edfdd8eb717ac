"""What commands do with files."""
