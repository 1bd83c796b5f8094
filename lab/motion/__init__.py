"""Motion of people: gait, feet that stay where they stand, paths that avoid each other."""
