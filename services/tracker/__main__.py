"""Run the tracker."""

import sys

from common.runtime import process
from services.tracker.build import build
from services.tracker.config import TrackerConfig


def main() -> int:
    """Run the service and return its exit code."""
    return process.main("tracker", TrackerConfig, build)


if __name__ == "__main__":
    sys.exit(main())
