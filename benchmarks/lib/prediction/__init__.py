"""Comparison of predicted and true paths."""
