"""Recordings with ground truth: detections, embeddings and motion, made once and cached."""
