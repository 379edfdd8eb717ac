"""File formats, one module each: the only place that touches files and flips rows."""
