"""Recordings for other programs: tables, BIDS folders, bags of ROS 2, Rerun and Foxglove."""
