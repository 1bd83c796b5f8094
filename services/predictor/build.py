"""Build the node of the service from its configuration."""

from services.predictor.config import PredictorConfig
from services.predictor.node import PredictorNode


def build(config: PredictorConfig) -> PredictorNode:
    """Build the node."""
    return PredictorNode(config)
