"""Run the ground-truth bridge: python -m services.gt_bridge --set truth=FILE."""

import sys

from common.runtime import process
from services.gt_bridge.build import build
from services.gt_bridge.config import GtBridgeConfig


def main() -> int:
    """Run until stopped, or until all truth is out at recorded pace."""
    return process.main("gt_bridge", GtBridgeConfig, build)


if __name__ == "__main__":
    sys.exit(main())
