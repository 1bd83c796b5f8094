"""Hostile bytes for every decoder and every file reader, made by a fuzzer that sees coverage."""
