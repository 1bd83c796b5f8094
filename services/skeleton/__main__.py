"""Run the skeleton service."""

import sys

from common.runtime import process
from services.skeleton.build import build
from services.skeleton.config import SkeletonConfig

if __name__ == "__main__":
    sys.exit(process.main("skeleton", SkeletonConfig, build))
