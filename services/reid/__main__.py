"""Re-identification as a process: python -m services.reid."""

import sys

from common.runtime import process
from services.reid.build import build
from services.reid.config import ReidConfig


def main() -> int:
    """Run the service."""
    return process.main("reid", ReidConfig, build)


if __name__ == "__main__":
    sys.exit(main())
