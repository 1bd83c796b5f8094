"""Build the node of the service from its configuration."""

from common.runtime.node import Node
from services.reid.config import ReidConfig
from services.reid.embedders import load_embedder
from services.reid.node import ReidNode


def build(config: ReidConfig) -> Node:
    """Build the node and load its network, so that an absent network is reported at the start."""
    return ReidNode(load_embedder(config))
