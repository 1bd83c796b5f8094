"""Build the node of the service from its configuration."""

from common.runtime.node import Node
from services.camera.config import CameraConfig
from services.camera.node import CameraNode
from services.camera.sources import open_source


def build(config: CameraConfig) -> Node:
    """Make the camera; its source is opened here, so that a wrong one is reported at start."""
    return CameraNode(config, open_source(config.source, config.kind, config.options))
