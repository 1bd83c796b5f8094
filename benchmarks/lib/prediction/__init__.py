"""Predicted paths beside the true ones."""
