"""Reports gathered from files: runs, batches, maps, and what was found out about them."""
