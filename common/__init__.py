"""Shared nouns and seams: messages, topics, buses, the process loop, geometry, inference."""
