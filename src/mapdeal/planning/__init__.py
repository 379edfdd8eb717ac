"""Ways through a costmap: from grids and two points to a route."""
