"""Commands that start, stop and watch a system."""
