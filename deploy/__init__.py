"""What runs the system: the process picture, the launcher, the command line."""
