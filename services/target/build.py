"""Build the node of the service from its configuration."""

from services.target.config import TargetConfig
from services.target.node import TargetNode


def build(config: TargetConfig) -> TargetNode:
    """Build the node."""
    return TargetNode(config)
