"""Run the detector: python -m services.detector."""

import sys

from common.runtime import process
from services.detector.build import build
from services.detector.config import DetectorConfig

if __name__ == "__main__":
    sys.exit(process.main("detector", DetectorConfig, build))
