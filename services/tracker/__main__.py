"""Run the tracker."""

import sys

from common import process
from services.tracker.config import TrackerConfig
from services.tracker.node import TrackerNode
from services.tracker.registry import make_tracker


def build(config: TrackerConfig) -> TrackerNode:
    """Build the node with the tracker that the configuration names."""
    return TrackerNode(config, make_tracker(config))


def main() -> int:
    """Run the service and return its exit code."""
    return process.main("tracker", TrackerConfig, build)


if __name__ == "__main__":
    sys.exit(main())
