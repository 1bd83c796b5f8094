"""Hostile bytes for every decoder and every file reader, made by a coverage-guided fuzzer."""
