"""Run the gait service."""

import os
import sys

from common.runtime import process
from services.gait.build import build_compiled
from services.gait.config import GaitConfig

NICE = 10  # other processes on its core have priority


def main() -> int:
    """Run the service and return its exit code."""
    os.nice(NICE)
    return process.main("gait", GaitConfig, build_compiled)


if __name__ == "__main__":
    sys.exit(main())
