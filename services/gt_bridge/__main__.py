"""Run the ground-truth bridge: python -m services.gt_bridge --set truth=FILE."""

import sys

from common.runtime import process
from services.gt_bridge.build import build
from services.gt_bridge.config import GtBridgeConfig

if __name__ == "__main__":
    sys.exit(process.main("gt_bridge", GtBridgeConfig, build))
