"""Run re-identification: python -m services.reid."""

import sys

from common.runtime import process
from services.reid.build import build
from services.reid.config import ReidConfig

if __name__ == "__main__":
    sys.exit(process.main("reid", ReidConfig, build))
