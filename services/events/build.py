"""Build the node of the service from its configuration."""

from services.events.config import EventsConfig
from services.events.node import EventsNode


def build(config: EventsConfig) -> EventsNode:
    """Build the node; it opens its files when the loop attaches."""
    return EventsNode(config)
