"""A running session for other programs: ROS 2 and Rerun are told what the servo process publishes, and only that."""
