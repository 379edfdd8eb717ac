"""What lint has found, in the forms that people and machines read."""
