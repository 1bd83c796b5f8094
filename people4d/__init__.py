"""People around a robot: messages, topics, codec and client of a running system."""
