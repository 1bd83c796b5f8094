"""People: baked figures, dressed and posed."""
