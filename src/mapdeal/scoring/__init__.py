"""How good a map is: on its own, and against a map that is true."""
