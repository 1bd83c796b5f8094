"""The camera as a process: python -m services.camera --set source=PATH."""

import sys

from common.runtime import process
from services.camera.build import build
from services.camera.config import CameraConfig


def main() -> int:
    """Run the camera."""
    return process.main("camera", CameraConfig, build)


if __name__ == "__main__":
    sys.exit(main())
