"""Data sets of robots: cameras that move, with depth or a person to follow."""
