"""One thing that is fuzzed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Target:
    """What reads untrusted bytes; it may refuse them with a People4dError, and nothing else.

    Args:
        name: Its name.
        read: Reads bytes; gets an empty folder for files, and what is in it does not matter.
        seeds: Makes sound inputs to begin with; gets a folder to make them in.
        words: What the fuzzer may put in, beside what it finds by itself.
        max_bytes: Longest input.
    """

    name: str
    read: Callable[[bytes, Path], None]
    seeds: Callable[[Path], Sequence[bytes]]
    words: Sequence[bytes] = ()
    max_bytes: int = 4096
