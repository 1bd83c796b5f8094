"""Positions of people from depth (docs/method.md sections 2, 8.2 and 10)."""
