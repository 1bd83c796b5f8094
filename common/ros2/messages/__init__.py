"""Messages of people4d as fields of ROS 2 messages, for `types.encode`."""
