"""Run the gait service."""

import os
import sys

from common import process
from services.gait.config import GaitConfig
from services.gait.node import GaitNode, Watch
from services.gait.warm_up import warm_up

NICE = 10  # whoever shares a core with it goes first: people are told before how they walk


def build(config: GaitConfig, watch: Watch | None = None) -> GaitNode:
    """Build the node; `watch` is told of every frame that was done."""
    return GaitNode(config, watch)


def start(config: GaitConfig) -> GaitNode:
    """Build the node once it can work without a pause."""
    warm_up(config)
    return build(config)


def main() -> int:
    """Run the service and return its exit code."""
    os.nice(NICE)
    return process.main("gait", GaitConfig, start)


if __name__ == "__main__":
    sys.exit(main())
