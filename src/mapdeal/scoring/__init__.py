"""Quality of a map: on its own, and against the ground truth."""
