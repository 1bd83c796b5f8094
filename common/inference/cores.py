"""Cores reserved for networks.

Where cores are few, threads that wake for a message interrupt a network that runs, again and again,
since the scheduler prefers threads that have slept. A core of its own lets the network finish.
"""

import logging
import os
from collections.abc import Callable, Mapping, Set
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from people4d.errors import ConfigError

VARIABLE = "PEOPLE4D_INFERENCE_CORES"
CORES_MAX = 4096  # of one computer
HINT = "Write cores of this computer as in 0,2 or 2-3, and leave at least one to all else."

T = TypeVar("T")

log = logging.getLogger("people4d")


class InferenceCores:
    """Cores on which networks of this process run, and nothing else of it.

    Without a reservation networks run in the threads of their callers, on all cores.
    """

    def __init__(self) -> None:
        self._threads: ThreadPoolExecutor | None = None  # on the cores for networks

    def reserve(self, environment: Mapping[str, str]) -> None:
        """Reserve the cores that the environment names; from then on other threads leave them.

        Call it before the process starts threads: they inherit the cores of their parent.

        Args:
            environment: Variables of the process; `PEOPLE4D_INFERENCE_CORES` as in "1" or "2-3".

        Raises:
            ConfigError: It names no cores of this computer, or all of them.
        """
        text = environment.get(VARIABLE)
        if not text:
            return
        named = read_cores(text)
        if not hasattr(os, "sched_setaffinity"):
            raise ConfigError(f"{VARIABLE} needs Linux", "Unset it.")
        allowed = os.sched_getaffinity(0)
        if not named < allowed:
            raise ConfigError(
                f"{VARIABLE} is {text!r}, this process may use the cores {listed(allowed)}", HINT
            )
        # Threads of their own: to move one to another core that is busy takes milliseconds.
        self._threads = ThreadPoolExecutor(
            len(named), "inference", initializer=bind, initargs=(named,)
        )
        bind(allowed - named)

    def run(self, function: Callable[[], T]) -> T:
        """Return the result of a function that runs a network or starts its threads."""
        return function() if self._threads is None else self._threads.submit(function).result()


def bind(cores: Set[int]) -> None:
    """Bind the calling thread to cores; where the system forbids it, say so and go on."""
    try:
        os.sched_setaffinity(0, cores)
    except OSError as error:
        log.warning("a thread cannot be bound to the cores %s: %s", listed(cores), error)


def read_cores(text: str) -> frozenset[int]:
    """Return the cores of a list such as "0,2" or "2-3".

    Raises:
        ConfigError: It is no such list.
    """
    cores: set[int] = set()
    try:
        for part in text.split(","):
            first, dash, last = part.partition("-")
            begin, end = int(first), int(last if dash else first)
            if not 0 <= begin <= end < CORES_MAX:
                raise ValueError
            cores.update(range(begin, end + 1))
    except ValueError:
        raise ConfigError(f"{VARIABLE} is {text!r}", HINT) from None
    return frozenset(cores)


def listed(cores: Set[int]) -> str:
    """Return cores as text, with commas between."""
    return ",".join(map(str, sorted(cores)))


CORES = InferenceCores()  # of this process
