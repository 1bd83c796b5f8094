"""Skeletons: the joints of tracked people in 3D, hidden ones predicted."""
