"""Run the visual odometry: python -m services.visual_odometry."""

import sys

from common.runtime import process
from services.visual_odometry.build import build
from services.visual_odometry.config import VisualOdometryConfig

if __name__ == "__main__":
    sys.exit(process.main("visual_odometry", VisualOdometryConfig, build))
