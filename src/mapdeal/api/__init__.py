"""What Python users call that works as commands do: words and paths in, values out."""
