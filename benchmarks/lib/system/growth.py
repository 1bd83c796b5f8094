"""Growth of the memory of processes: samples, and a robust slope with its interval."""

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
import psutil

T = TypeVar("T")

SHARED_MEMORY = Path("/dev/shm")
WINDOW_S = 60.0  # whose median is one point of the fit
BLOCK = 5  # windows that are drawn together: neighbours are correlated
DRAWS = 1000


@dataclass
class ProcessSamples:
    """Samples of one process.

    Args:
        times_s: When, monotonic.
        memory_mb: See `written_mb`.
        descriptors: Open file descriptors.
    """

    times_s: list[float] = field(default_factory=list)
    memory_mb: list[float] = field(default_factory=list)
    descriptors: list[int] = field(default_factory=list)


class Observer:
    """Samples processes and shared memory in a thread of its own.

    Args:
        processes: Process numbers by name.
        every_s: Time between two samples.
    """

    def __init__(self, processes: dict[str, int], every_s: float) -> None:
        self.samples = {name: ProcessSamples() for name in processes}
        self.shared_mb: list[float] = []
        self._processes = {name: psutil.Process(pid) for name, pid in processes.items()}
        self._closed = threading.Event()
        self._every_s = every_s
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End."""
        self._closed.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._closed.wait(self._every_s):
            for name, process in self._processes.items():
                samples = self.samples[name]
                samples.times_s.append(time.monotonic())
                samples.memory_mb.append(written_mb(process.pid))
                samples.descriptors.append(process.num_fds())
            mapped = set[str]().union(*map(_shared_files, self._processes.values()))
            self.shared_mb.append(sum(_size_mb(Path(file)) for file in mapped))


def written_mb(pid: int) -> float:
    """Return the memory that a process has written and does not share, in MB.

    Pages of libraries do not count: they become private when the last other process ends that has
    them, too, and shared when one starts.
    """
    rollup = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="utf-8")
    fields = dict(line.split(":") for line in rollup.splitlines()[1:])
    return int(fields["Private_Dirty"].split()[0]) / 1024


def slope(times_s: Sequence[float], values: Sequence[float]) -> tuple[float, float, float]:
    """Return the slope of values per hour and its interval of 95 %.

    The slope is the median of those between all pairs of windows of a minute [Theil-Sen], each
    window counting with its median. The interval is that of a moving-block bootstrap of the
    residuals, since neighbouring windows are correlated.

    Args:
        times_s: When, at least two windows.
        values: What was measured then.
    """
    hours, medians = _windows(np.asarray(times_s), np.asarray(values))
    middle = _theil_sen(hours, medians)
    line = middle * hours
    residuals = medians - line
    random, block = np.random.default_rng(0), min(BLOCK, len(hours))
    drawn = []
    for _ in range(DRAWS):
        starts = random.integers(0, len(hours) - block + 1, -(-len(hours) // block))
        order = (starts[:, None] + np.arange(block)).ravel()[: len(hours)]
        drawn.append(_theil_sen(hours, line + residuals[order]))
    low, high = np.percentile(drawn, (2.5, 97.5))
    return middle, float(low), float(high)


def after_warm_up(values: list[T], share: float) -> list[T]:
    """Return values without the first share of them."""
    return values[int(share * len(values)) :]


def _windows(times_s: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    span_s = float(times_s[-1] - times_s[0])
    count = max(int(span_s / WINDOW_S), 2)
    numbers = np.minimum(((times_s - times_s[0]) / span_s * count).astype(int), count - 1)
    used = np.unique(numbers)
    hours = np.array([times_s[numbers == n].mean() for n in used]) / 3600
    return hours - hours.mean(), np.array([np.median(values[numbers == n]) for n in used])


def _theil_sen(hours: np.ndarray, values: np.ndarray) -> float:
    first, second = np.triu_indices(len(hours), 1)
    return float(np.median((values[second] - values[first]) / (hours[second] - hours[first])))


def _shared_files(process: psutil.Process) -> set[str]:
    """Return the files in shared memory that a process has mapped."""
    lines = Path(f"/proc/{process.pid}/maps").read_text(encoding="utf-8").splitlines()
    return {line.split()[-1] for line in lines if f" {SHARED_MEMORY}/" in line}


def _size_mb(file: Path) -> float:
    try:
        return file.stat().st_size / 2**20
    except FileNotFoundError:  # it was there a moment ago
        return 0.0
