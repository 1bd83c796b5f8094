"""How people move: a gait, feet that stay where they stand, ways that avoid each other."""
