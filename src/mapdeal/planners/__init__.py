"""Nav2's global planners: what each finds on a costmap, by the rules of its own code."""
