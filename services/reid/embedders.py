"""Interface of embedders, and the embedders by name."""

from collections.abc import Sequence
from typing import Protocol

from common import registry
from common.io import weights
from people4d.messages import F32, Crop
from services.reid.config import NETWORKS, ReidConfig

EMBEDDERS: dict[str, str] = {
    "appearance": "services.reid.appearance:load",
    "histogram": "services.reid.histogram:load",
    "osnet": "services.reid.osnet:load",
}


class Embedder(Protocol):
    """Maps crops of people to vectors; vectors of one person are close."""

    @property
    def name(self) -> str:
        """Name of the embedder; only vectors of one name are comparable."""
        ...

    @property
    def dimension(self) -> int:
        """Length of a vector."""
        ...

    def embed(self, crops: Sequence[Crop]) -> F32:
        """Return the vectors of N crops: NxD, rows of unit length; cosine distance is 1 - a.b."""
        ...


def load_embedder(config: ReidConfig) -> Embedder:
    """Build the configured embedder, importing its module on demand.

    Args:
        config: `embedder` is a name of EMBEDDERS, or module:Class, called with `config`.

    Raises:
        ConfigError: The name is unknown, or the module or class cannot be found.
        ModelError: The embedder's network is absent, altered or of another form.
    """
    embedder: Embedder = registry.find("embedder", EMBEDDERS, config.embedder)(config)
    return embedder


def check_embedder(config: ReidConfig) -> None:
    """Check that the configured embedder can be made, without loading its network.

    Raises:
        ConfigError: The name is unknown, or the module or class cannot be found.
        ModelError: The embedder's network is absent or altered.
    """
    registry.find("embedder", EMBEDDERS, config.embedder)
    if config.embedder in NETWORKS:
        weights.locate(config.network, config.folder)
