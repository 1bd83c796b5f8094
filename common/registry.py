"""Algorithms, models and sources by name, or as `module:Class` of a plug-in."""

import importlib
import os
import sys
from collections.abc import Mapping
from typing import Any

from people4d.errors import ConfigError


def find(what: str, registry: Mapping[str, str], name: str, *others: str) -> Any:
    """Return the class or function of a name, importing its module on demand.

    Plug-ins are searched last in the folders of $PEOPLE4D_PLUGINS, which the command `people4d`
    sets to PYTHONPATH and the working directory. ConfigError if the name is unknown, or its module
    or attribute cannot be found.

    Args:
        what: Kind of thing, for the error.
        registry: Name to "module:attribute".
        name: A name of the registry, or "module:attribute" of a plug-in.
        others: Further names for the error.
    """
    module, separator, attribute = registry.get(name, name).partition(":")
    if not separator:
        raise ConfigError(
            f"{what} {name!r} is unknown",
            f"Choose {', '.join([*others, *registry])}, or module:Class of a plug-in.",
        )
    if name not in registry:
        folders = os.environ.get("PEOPLE4D_PLUGINS", "").split(os.pathsep)
        sys.path += [folder for folder in folders if folder and folder not in sys.path]
    try:
        return getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise ConfigError(
            f"{what} {name!r} cannot be loaded: {error}",
            "" if name in registry else "Its folder must be on PYTHONPATH.",
        ) from error
