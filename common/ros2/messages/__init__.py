"""Messages of ours as messages of ROS 2: nested mappings of fields, which `types.encode` takes."""
