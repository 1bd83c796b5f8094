"""Bake the bodies of the virtual lab."""
