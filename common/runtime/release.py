"""Which release of people4d this is."""

import functools
import importlib.metadata


@functools.cache
def release() -> str:
    """Return the version of the installed package, for example "0.1.0"."""
    return importlib.metadata.version("people4d")
