"""Build the node of the service from its configuration."""

from services.visual_odometry.config import VisualOdometryConfig
from services.visual_odometry.node import VisualOdometryNode


def build(config: VisualOdometryConfig) -> VisualOdometryNode:
    """Build the node."""
    return VisualOdometryNode(config)
