"""Evaluation of methods against ground truth: offline, frame by frame, reproducible."""
