"""Crops of people to unit-length embeddings."""
