"""Boxes of people followed by their colours."""
