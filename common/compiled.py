"""Functions compiled to machine code on their first call."""

from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import CellType, FunctionType
from typing import TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a function on numbers and arrays; it releases the interpreter lock.

    The code is cached on disk, next to the module or in the user's cache folder, so only the first
    run waits for the compiler. If neither is writable, every run waits.
    """
    keyed = _keyed(cast(FunctionType, function))
    try:
        return cast(F, njit(cache=True, nogil=True)(keyed))
    except RuntimeError:  # no cache folder, for example without a user in a container
        return cast(F, njit(nogil=True)(keyed))


def _keyed(function: FunctionType) -> FunctionType:
    """Return a function whose cached code is invalidated by a change of its sources.

    Cached code contains the functions called, but Numba checks only the file of the caller for
    changes. It also distinguishes functions by their closures, so this one encloses a fingerprint
    of all files with compiled functions in its folder.
    """
    code = function.__code__.replace(co_freevars=("sources",))
    sources = CellType(_fingerprint(Path(function.__code__.co_filename).parent))
    defaults = function.__defaults__
    keyed = FunctionType(code, function.__globals__, function.__name__, defaults, (sources,))
    keyed.__qualname__, keyed.__doc__ = function.__qualname__, function.__doc__
    keyed.__module__ = function.__module__
    return keyed


@cache
def _fingerprint(folder: Path) -> str:
    """Return a hash of the files of a folder that have compiled functions."""
    texts = [path.read_bytes() for path in sorted(folder.glob("*.py"))]
    return sha256(b"".join(text for text in texts if b"@compiled" in text)).hexdigest()
