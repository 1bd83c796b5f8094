"""Gait in recordings: points of bodies, steps, tables and images."""
