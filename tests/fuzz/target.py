"""One target of fuzzing."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Target:
    """A reader of untrusted bytes, which raises nothing but People4dError.

    Args:
        name: Its name.
        read: Reads bytes; gets a scratch folder for files.
        seeds: Makes valid inputs to begin with; gets a folder to make them in.
        words: Byte strings for the fuzzer to insert.
        max_bytes: Longest input.
    """

    name: str
    read: Callable[[bytes, Path], None]
    seeds: Callable[[Path], Sequence[bytes]]
    words: Sequence[bytes] = ()
    max_bytes: int = 4096
