"""The detector as a process: python -m services.detector."""

import sys

from common.runtime import process
from services.detector.build import build
from services.detector.config import DetectorConfig


def main() -> int:
    """Run the detector; two threads, so that one prepares a frame while the other infers."""
    return process.main("detector", DetectorConfig, build, workers=2)


if __name__ == "__main__":
    sys.exit(main())
