"""Benchmark of objects that are detected as people."""
