"""Exporters for Prometheus and OpenTelemetry, through their own libraries."""
