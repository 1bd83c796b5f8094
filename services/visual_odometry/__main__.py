"""Run the visual odometry."""

import sys

from common import process
from services.visual_odometry.config import VisualOdometryConfig
from services.visual_odometry.node import VisualOdometryNode


def build(config: VisualOdometryConfig) -> VisualOdometryNode:
    """Build the node."""
    return VisualOdometryNode(config)


def main() -> int:
    """Run the service and return its exit code."""
    return process.main("visual_odometry", VisualOdometryConfig, build)


if __name__ == "__main__":
    sys.exit(main())
