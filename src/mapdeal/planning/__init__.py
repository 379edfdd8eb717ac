"""Routes through a costmap, route graphs and tours."""
