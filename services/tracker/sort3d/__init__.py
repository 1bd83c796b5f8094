"""SORT-3D."""
