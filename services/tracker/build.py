"""Build the node of the service from its configuration."""

from services.tracker.config import TrackerConfig
from services.tracker.node import TrackerNode
from services.tracker.registry import make_tracker


def build(config: TrackerConfig) -> TrackerNode:
    """Build the node with the tracker that the configuration names."""
    return TrackerNode(config, make_tracker(config))
