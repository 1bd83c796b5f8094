"""Measured comparisons; each module prints its table and writes it beside itself."""
