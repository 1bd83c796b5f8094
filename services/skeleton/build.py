"""Build the node of the service from its configuration."""

from services.skeleton.config import SkeletonConfig
from services.skeleton.node import SkeletonNode


def build(config: SkeletonConfig) -> SkeletonNode:
    """Build the node."""
    return SkeletonNode(config)
