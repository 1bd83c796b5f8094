"""Measured comparisons; each module prints its table and writes it to a page of its name."""
