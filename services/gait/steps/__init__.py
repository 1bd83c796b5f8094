"""Steps from the trajectories of two feet."""
