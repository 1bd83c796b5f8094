"""Build the node of the service from its configuration."""

from common.runtime.node import Node
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.node import GtBridgeNode
from services.gt_bridge.sources.registry import open_truth


def build(config: GtBridgeConfig) -> Node:
    """Open the truth and make the node."""
    return GtBridgeNode(open_truth(config), config)
