"""Identities of people who return."""
