"""Commands that show or export messages and latencies as they come."""
