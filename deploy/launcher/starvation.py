"""Processes that are slow because the machine is: time in which they waited for a processor."""

from collections.abc import Iterable
from pathlib import Path

PROC = Path("/proc")
SLOWDOWN_MAX = 10.0
WINDOW_S = 2.0


class Starvation:
    """Slowdown of processes, by the scheduler's statistics of their threads.

    A thread that could run but gets no processor waits in the run queue, and the kernel counts that
    time. A process that is stopped, or waits for a lock or a device, neither runs nor waits there.

    Args:
        proc: Folder of the kernel's statistics.
    """

    def __init__(self, proc: Path = PROC) -> None:
        self._proc = proc
        self._samples: dict[int, list[tuple[float, int, int]]] = {}  # time, ran and waited [ns]

    def update(self, pids: Iterable[int], now_s: float) -> None:
        """Read the statistics of processes, and forget all others."""
        samples = {}
        for pid in pids:
            known = self._samples.get(pid, [])
            recent = [sample for sample in known if now_s - sample[0] <= WINDOW_S]
            samples[pid] = [*recent, (now_s, *self._read(pid))]
        self._samples = samples

    def slowdown(self, pid: int) -> float:
        """Return how many times longer a process takes than with a processor of its own.

        It is 1 to 10, of the last seconds; 1 if it did not want to run, or nothing is known.
        """
        samples = self._samples.get(pid, [])
        if len(samples) < 2:
            return 1.0
        (_, ran, waited), (_, ran_now, waited_now) = samples[0], samples[-1]
        wanted_ns = ran_now - ran + waited_now - waited
        return min(max(wanted_ns / max(ran_now - ran, 1), 1.0), SLOWDOWN_MAX)

    def _read(self, pid: int) -> tuple[int, int]:
        """Return for how long the threads of a process ran and waited [ns]."""
        ran = waited = 0
        try:
            for file in (self._proc / str(pid) / "task").glob("*/schedstat"):
                numbers = file.read_text("ascii").split()
                ran, waited = ran + int(numbers[0]), waited + int(numbers[1])
        except (OSError, ValueError, IndexError):  # it ended, or the kernel keeps no statistics
            return 0, 0
        return ran, waited
