"""Commands that show or export live messages and latencies."""
