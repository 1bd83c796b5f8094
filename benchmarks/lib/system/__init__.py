"""Running systems of services and cameras, and their measurements."""
