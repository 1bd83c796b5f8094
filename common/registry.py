"""Algorithms, models and sources by name, or as `module:Class` of a plug-in."""

import importlib
from collections.abc import Mapping
from typing import Any

from people4d.errors import ConfigError


def find(what: str, registry: Mapping[str, str], name: str, *others: str) -> Any:
    """Return the class or function that a name stands for; its module is imported only now.

    Args:
        what: What it is, for the error.
        registry: Name to "module:attribute".
        name: A name of the registry, or "module:attribute" of something outside.
        others: Further names that the error shall offer.

    Raises:
        ConfigError: The name is unknown, or its module or attribute cannot be found.
    """
    module, separator, attribute = registry.get(name, name).partition(":")
    if not separator:
        raise ConfigError(
            f"{what} {name!r} is unknown",
            f"Choose {', '.join([*others, *registry])}, or module:Class of your own.",
        )
    try:
        return getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise ConfigError(
            f"{what} {name!r} cannot be loaded: {error}",
            "" if name in registry else "Its folder must be on PYTHONPATH.",
        ) from error
