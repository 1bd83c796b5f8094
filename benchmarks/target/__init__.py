"""Benchmark of the chosen person, beside following the identities of trackers."""

from benchmarks.target.table import main

__all__ = ["main"]
