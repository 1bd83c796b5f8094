"""The embedders by name."""

import importlib

from common.errors import ConfigError
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
    place = EMBEDDERS.get(config.embedder, config.embedder)
    module_name, separator, attribute = place.partition(":")
    if not separator:
        raise ConfigError(
            f"embedder {config.embedder!r} is unknown",
            f"Choose {', '.join(EMBEDDERS)}, or module:Class of your own.",
        )
    try:
        make = getattr(importlib.import_module(module_name), attribute)
    except (ImportError, AttributeError) as error:
        raise ConfigError(f"embedder {config.embedder!r} cannot be loaded: {error}") from error
    embedder: Embedder = make(config)
    return embedder
