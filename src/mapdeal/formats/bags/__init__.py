"""Recordings of ROS 1 and ROS 2: one file for each container, and what their messages mean."""
