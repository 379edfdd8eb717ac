"""Parameter files of robots: parsing, and the effect of the values on costmaps."""
