"""Re-identification as a process: python -m services.reid."""

import sys

from common import process
from common.node import Node
from services.reid.config import ReidConfig
from services.reid.embedders import load_embedder
from services.reid.node import ReidNode


def build(config: ReidConfig) -> Node:
    """Make the node; its network is loaded here, so that a missing one is told at start."""
    return ReidNode(load_embedder(config))


def main() -> int:
    """Run the service."""
    return process.main("reid", ReidConfig, build)


if __name__ == "__main__":
    sys.exit(main())
