"""Threads and cores of networks.

A network in its own thread stays on one core, with its weights in the cache of that core. The next
frame starts immediately after the previous one, without waiting for the interpreter lock. With few
cores, threads that wake for messages interrupt the network, since the scheduler prefers threads
that have slept. A reserved core avoids these interruptions.
"""

import logging
import os
import time
from collections.abc import Callable, Mapping, Set
from concurrent.futures import ThreadPoolExecutor
from threading import Lock
from typing import TypeVar

from common.transport.trace import record
from people4d.errors import ConfigError

VARIABLE = "PEOPLE4D_DETECTOR_CORES"
CORES_MAX = 4096  # maximum number of cores of a computer
HINT = "Write cores of this computer as in 0,2 or 2-3, and leave at least one unused."

T = TypeVar("T")

log = logging.getLogger("people4d")


class InferenceCores:
    """Cores of slow networks: all cores, or cores reserved from other threads of this process."""

    def __init__(self) -> None:
        self._reserved: frozenset[int] = frozenset()

    def reserve(self, environment: Mapping[str, str]) -> None:
        """Reserve the cores named in the environment; other threads do not use them.

        Call this before the process starts threads, since they inherit the cores of their parent.

        Args:
            environment: Variables of the process; `PEOPLE4D_DETECTOR_CORES` as in "1" or "2-3".

        Raises:
            ConfigError: The cores do not exist, or no other core remains.
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
                f"{VARIABLE}={text} must name some, not all, of the cores {listed(allowed)}", HINT
            )
        self._reserved = named
        bind(allowed - named)

    def thread(self) -> ThreadPoolExecutor:
        """Start a thread on these cores; its child threads inherit them."""
        if not self._reserved:
            return ThreadPoolExecutor(1, "inference")
        return ThreadPoolExecutor(1, "inference", initializer=bind, initargs=(self._reserved,))


class NetworkRuns:
    """Runs of one network, one at a time.

    Args:
        cores: Cores of the network's thread; None: run in the threads of the callers, which is
            faster for networks that take less than a millisecond.
    """

    def __init__(self, cores: InferenceCores | None) -> None:
        self._thread = None if cores is None else cores.thread()
        self._turn = Lock()

    def call(self, function: Callable[[], T]) -> T:
        """Return the result of a function that loads the network."""
        return function() if self._thread is None else self._thread.submit(function).result()

    def run(self, function: Callable[[], T]) -> T:
        """Return the result of a function that runs the network, and record its time."""
        asked_ns = time.time_ns()

        def run() -> tuple[T, int, int]:
            with self._turn:
                begin_ns = time.time_ns()
                return function(), begin_ns, time.time_ns()

        result, begin_ns, end_ns = self.call(run)
        record("inference_wait", asked_ns, begin_ns)
        record("inference", begin_ns, end_ns)
        if self._thread is not None:
            record("wake", end_ns, time.time_ns())
        return result


def bind(cores: Set[int]) -> None:
    """Bind the calling thread to cores; log a warning if the system forbids it."""
    try:
        os.sched_setaffinity(0, cores)
    except OSError as error:
        log.warning("a thread cannot be bound to the cores %s: %s", listed(cores), error)


def read_cores(text: str) -> frozenset[int]:
    """Return the cores of a list such as "0,2" or "2-3".

    Raises:
        ConfigError: The text is not such a list.
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
    """Return cores as text, separated by commas."""
    return ",".join(map(str, sorted(cores)))


DETECTOR = InferenceCores()  # reserved cores of this process
