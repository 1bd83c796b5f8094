"""Exporter for Prometheus, through its own library."""
