"""Build the node of the service from its configuration."""

from services.gait.config import GaitConfig
from services.gait.node import GaitNode, Watch
from services.gait.warm_up import warm_up


def build(config: GaitConfig, watch: Watch | None = None) -> GaitNode:
    """Build the node; `watch` is told of every frame that was done."""
    return GaitNode(config, watch)


def start(config: GaitConfig) -> GaitNode:
    """Build the node once it can work without a pause."""
    warm_up(config)
    return build(config)
