"""Build the node of the service from its configuration."""

from msgspec.structs import replace

from common.runtime.node import Node
from services.detector.config import DetectorConfig
from services.detector.models.base import PersonModel
from services.detector.models.registry import load_model
from services.detector.node import DetectorNode


def build(config: DetectorConfig, model: PersonModel | None = None) -> Node:
    """Make the detector; its model is loaded here, so that a missing one is reported at start."""
    near, near_model = config.near_input, None
    if near.height:
        settings = replace(config, input_height=near.height, input_width=near.width)
        near_model = load_model(settings)
    return DetectorNode(model or load_model(config), config, near_model)
