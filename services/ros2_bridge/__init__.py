"""Bridge to ROS 2: our streams as topics."""
