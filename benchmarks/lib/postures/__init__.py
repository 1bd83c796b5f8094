"""Scenes of postures, falls and gestures, and the services that see them."""
