"""Run the service of the chosen person."""

import sys

from common.runtime import process
from services.target.build import build
from services.target.config import TargetConfig

if __name__ == "__main__":
    sys.exit(process.main("target", TargetConfig, build))
