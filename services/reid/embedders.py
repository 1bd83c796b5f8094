"""The embedders by name."""

from common import registry
from services.reid.config import ReidConfig
from services.reid.embedder import Embedder

EMBEDDERS: dict[str, str] = {
    "histogram": "services.reid.histogram:load",
    "osnet": "services.reid.osnet:load",
}


def load_embedder(config: ReidConfig) -> Embedder:
    """Make the configured embedder; its module is imported only now.

    Args:
        config: `embedder` is a name of EMBEDDERS, or module:Class, called with `config`.

    Raises:
        ConfigError: The name is unknown, or the module or class cannot be found.
        ModelError: The embedder's network is absent, altered or of another form.
    """
    embedder: Embedder = registry.find("embedder", EMBEDDERS, config.embedder)(config)
    return embedder
