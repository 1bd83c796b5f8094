"""Recordings with ground truth, and their cached detections, embeddings and motion."""
