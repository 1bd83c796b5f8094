"""Run the bridge to ROS 2: python -m services.ros2_bridge."""

import sys

from common.runtime import process
from services.ros2_bridge.build import build
from services.ros2_bridge.config import Ros2BridgeConfig

if __name__ == "__main__":
    sys.exit(process.main("ros2_bridge", Ros2BridgeConfig, build))
