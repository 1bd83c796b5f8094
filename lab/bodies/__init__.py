"""Bodies of people: baked figures, clothes and poses."""
