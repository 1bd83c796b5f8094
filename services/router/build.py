"""Build the node of the service from its configuration."""

from common.runtime.node import Node
from services.router.config import RouterConfig
from services.router.node import RouterNode


def build(config: RouterConfig) -> Node:  # noqa: ARG001
    """Make the node."""
    return RouterNode()
