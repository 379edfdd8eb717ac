"""Two maps of one place: where one lies in the frame of the other, how well they agree."""
