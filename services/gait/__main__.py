"""Run the gait service."""

import os
import sys

from common.runtime import process
from services.gait.build import start
from services.gait.config import GaitConfig

NICE = 10  # processes that share a core with it go first


def main() -> int:
    """Run the service and return its exit code."""
    os.nice(NICE)
    return process.main("gait", GaitConfig, start)


if __name__ == "__main__":
    sys.exit(main())
