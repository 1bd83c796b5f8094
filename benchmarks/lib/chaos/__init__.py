"""Disturbances of a running system, and when they come."""
