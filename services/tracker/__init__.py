"""Detections and embeddings to tracks in `map`."""
