"""One target of fuzzing."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Target:
    """A reader of untrusted bytes, which raises People4dError only.

    Args:
        name: Name of the reader.
        read: Function of the bytes and a scratch folder.
        seeds: Function of a scratch folder that returns valid first inputs.
        words: Byte strings inserted by the fuzzer.
        max_bytes: Maximum length of an input.
    """

    name: str
    read: Callable[[bytes, Path], None]
    seeds: Callable[[Path], Sequence[bytes]]
    words: Sequence[bytes] = ()
    max_bytes: int = 4096
