"""Build the node of the service from its configuration."""

from services.gait.config import GaitConfig
from services.gait.estimator import OnFrame
from services.gait.node import GaitNode
from services.gait.warm_up import warm_up


def build(config: GaitConfig, on_frame: OnFrame | None = None) -> GaitNode:
    """Build the node; `on_frame` is called with every processed frame."""
    return GaitNode(config, on_frame)


def build_compiled(config: GaitConfig) -> GaitNode:
    """Build the node after compiling its kernels."""
    warm_up(config)
    return build(config)
