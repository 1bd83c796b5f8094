"""Rooms, light and pictures."""
