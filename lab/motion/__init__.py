"""Motion of people: gait, stances without slip, paths without collisions."""
