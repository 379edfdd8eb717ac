"""Map files: YAML, images, dialects, npz."""
