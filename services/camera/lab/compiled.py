"""Functions that are compiled to machine code when they are first called."""

from collections.abc import Callable
from typing import TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a function on numbers and arrays; it releases the interpreter lock.

    The code is kept on disk, beside the module or in the user's cache folder, so that only the
    first run of all waits for the compiler. Where neither can be written, every run does.
    """
    try:
        return cast(F, njit(cache=True, nogil=True)(function))
    except RuntimeError:  # no folder to keep it in, for example a container's unknown user
        return cast(F, njit(nogil=True)(function))
