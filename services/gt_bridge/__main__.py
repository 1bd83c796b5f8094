"""Run the ground-truth bridge: python -m services.gt_bridge --set truth=FILE."""

import sys

from common import process
from common.node import Node
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.node import GtBridgeNode
from services.gt_bridge.sources import open_truth


def build(config: GtBridgeConfig) -> Node:
    """Open the truth and make the node."""
    return GtBridgeNode(open_truth(config), config)


def main() -> int:
    """Run until stopped, or until all truth is out at recorded pace."""
    return process.main("gt_bridge", GtBridgeConfig, build)


if __name__ == "__main__":
    sys.exit(main())
