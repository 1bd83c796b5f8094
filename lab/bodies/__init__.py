"""The people: baked figures, dressed, and posed as motion asks."""
