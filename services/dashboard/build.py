"""Build the node of the service from its configuration."""

from services.dashboard.config import DashboardConfig
from services.dashboard.node import DashboardNode


def build(config: DashboardConfig) -> DashboardNode:
    """Build the node, which opens its port when the loop attaches."""
    return DashboardNode(config)
