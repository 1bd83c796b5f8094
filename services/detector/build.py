"""Build the node of the service from its configuration."""

from common.inference.engines import open_session
from common.io import weights
from common.runtime.node import Node
from services.detector.config import DetectorConfig
from services.detector.models.base import PersonModel
from services.detector.models.registry import check_model, load_model
from services.detector.node import DetectorNode
from services.detector.orientation.network import OrientationNetwork
from services.detector.position.body import BodyNetwork


def build(config: DetectorConfig, model: PersonModel | None = None) -> Node:
    """Build the node and load its models, so that absent models are reported at the start."""
    networks = load_networks(config)
    return DetectorNode(model or load_model(config), config, *networks)


def load_networks(config: DetectorConfig) -> tuple[OrientationNetwork | None, BodyNetwork | None]:
    """Load the networks of yaws and of bodies; None if the configuration needs none.

    Raises:
        ModelError: A file is absent, altered or another network.
    """
    sessions = [
        open_session(weights.locate(name, config.folder)[0]) if name else None
        for name in (config.orientation_network, config.body_network)
    ]
    return (
        OrientationNetwork(sessions[0]) if sessions[0] else None,
        BodyNetwork(sessions[1]) if sessions[1] else None,
    )


def check(config: DetectorConfig) -> None:
    """Check that the configured models can be loaded, without loading them.

    Raises:
        ConfigError: The kind of the people model is unknown or cannot be loaded.
        ModelError: A file is absent or altered.
    """
    check_model(config)
    for name in filter(None, (config.orientation_network, config.body_network)):
        weights.locate(name, config.folder)
