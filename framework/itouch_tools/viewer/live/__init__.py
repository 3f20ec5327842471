"""A running session for other programs: what the servo process publishes is passed on to ROS 2 and to Rerun."""
