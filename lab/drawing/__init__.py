"""Rooms, light and images."""
