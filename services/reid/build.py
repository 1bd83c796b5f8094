"""Build the node of the service from its configuration."""

from common.runtime.node import Node
from services.reid.config import ReidConfig
from services.reid.embedders import load_embedder
from services.reid.node import ReidNode


def build(config: ReidConfig) -> Node:
    """Make the node; its network is loaded here, so that a missing one is reported at start."""
    return ReidNode(load_embedder(config))
