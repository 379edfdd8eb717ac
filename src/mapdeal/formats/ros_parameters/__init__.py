"""Files of ROS parameters, read as ROS reads them."""
