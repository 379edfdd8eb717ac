"""A page of what was made of maps, and of what was found out about them."""
