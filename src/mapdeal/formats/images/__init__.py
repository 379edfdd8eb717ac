"""The image formats that maps may have, a module each, and the list of them."""
