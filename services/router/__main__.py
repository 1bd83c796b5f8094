"""Run the router; its process needs only the session."""

import sys

from common.runtime import process
from services.router.build import build
from services.router.config import RouterConfig


def main() -> int:
    """Run the service."""
    return process.main("router", RouterConfig, build, mode="router")


if __name__ == "__main__":
    sys.exit(main())
