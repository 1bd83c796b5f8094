"""Inference of networks on the CPU, by one of two engines."""
