"""Body extremities of tracked people: a cascaded RGB-D particle filter."""
