"""Build the node of the service from its configuration."""

from common.runtime.node import Node
from services.camera.config import CameraConfig
from services.camera.node import CameraNode
from services.camera.source import Source
from services.camera.sources import open_source


def build(config: CameraConfig, source: Source | None = None) -> Node:
    """Build the camera node; its source is opened here, so errors are reported at start."""
    return CameraNode(config, source or open_source(config.source, config.options))
