"""The chosen person: lock, search and output for a planner."""
