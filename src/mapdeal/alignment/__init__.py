"""Where one map lies in the frame of another: from two grids to a transform."""
