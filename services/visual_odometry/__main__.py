"""Run the visual odometry."""

import sys

from common.runtime import process
from services.visual_odometry.build import build
from services.visual_odometry.config import VisualOdometryConfig


def main() -> int:
    """Run the service and return its exit code."""
    return process.main("visual_odometry", VisualOdometryConfig, build)


if __name__ == "__main__":
    sys.exit(main())
