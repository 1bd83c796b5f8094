"""Topics of ROS 2 without ROS: types in CDR, and their transports."""
