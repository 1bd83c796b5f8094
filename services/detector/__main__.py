"""Run the detector: python -m services.detector."""

import sys

from common.runtime import process
from services.detector.build import build
from services.detector.config import DetectorConfig

if __name__ == "__main__":
    # Two threads, so that one prepares a frame while the other infers.
    sys.exit(process.main("detector", DetectorConfig, build, workers=2))
