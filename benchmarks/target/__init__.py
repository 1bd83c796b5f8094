"""Benchmark of the chosen person, beside following the identities of trackers."""
