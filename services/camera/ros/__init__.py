"""ROS bags and messages as RGB-D sources."""
