"""The camera as a process: python -m services.camera --set source=PATH."""

import sys

from common import process
from common.node import Node
from services.camera.config import CameraConfig
from services.camera.node import CameraNode
from services.camera.sources import open_source


def build(config: CameraConfig) -> Node:
    """Make the camera; its source is opened here, so that a wrong one is told at start."""
    return CameraNode(config, open_source(config.source, config.kind, config.options))


def main() -> int:
    """Run the camera."""
    return process.main("camera", CameraConfig, build)


if __name__ == "__main__":
    sys.exit(main())
