"""Nodes as processes: run loop, inbox, heartbeat, replicas, checkpoints."""
