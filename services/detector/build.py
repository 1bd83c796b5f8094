"""Build the node of the service from its configuration."""

from common.inference.engines import open_session
from common.io import weights
from common.runtime.node import Node
from services.detector.config import DetectorConfig
from services.detector.models.base import PersonModel
from services.detector.models.registry import check_model, load_model
from services.detector.node import DetectorNode
from services.detector.orientation.network import OrientationNetwork


def build(config: DetectorConfig, model: PersonModel | None = None) -> Node:
    """Build the node and load its models, so that absent models are reported at the start."""
    return DetectorNode(model or load_model(config), config, load_network(config))


def load_network(config: DetectorConfig) -> OrientationNetwork | None:
    """Load the configured orientation network; None if none is configured.

    Raises:
        ModelError: The file is absent, altered or another network.
    """
    if not config.orientation_network:
        return None
    path, _ = weights.locate(config.orientation_network, config.folder)
    return OrientationNetwork(open_session(path))


def check(config: DetectorConfig) -> None:
    """Check that the configured models can be loaded, without loading them.

    Raises:
        ConfigError: The kind of the people model is unknown or cannot be loaded.
        ModelError: A file is absent or altered.
    """
    check_model(config)
    if config.orientation_network:
        weights.locate(config.orientation_network, config.folder)
