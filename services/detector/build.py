"""Build the node of the service from its configuration."""

from common.runtime.node import Node
from services.detector.config import DetectorConfig
from services.detector.models.base import PersonModel
from services.detector.models.registry import load_model
from services.detector.node import DetectorNode


def build(config: DetectorConfig, model: PersonModel | None = None) -> Node:
    """Make the detector; its model is loaded here, so that a missing one is reported at start."""
    return DetectorNode(model or load_model(config), config)
