"""Steps by the trajectories of two feet."""
