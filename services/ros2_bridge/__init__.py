"""Bridge to ROS 2: messages of people4d as topics."""
