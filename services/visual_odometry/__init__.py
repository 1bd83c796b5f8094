"""How the camera moves, by what it sees."""
