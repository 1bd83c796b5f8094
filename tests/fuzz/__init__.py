"""Hostile bytes for all decoders and file readers, from a coverage-guided fuzzer."""
