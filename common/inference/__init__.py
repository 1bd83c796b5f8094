"""Inference: networks of models/ on the CPU, by one of two engines."""
