"""The whole pipeline for a long time at twice the rate that it can hold: does anything grow?

The sustainable rate is measured first, in lock-step. Then frames come twice as fast; the newest one
wins, so that every second frame is dropped and latency must stay what it is. Memory, file
descriptors and shared memory are sampled every few seconds, and a line is fitted through each
process's memory after a time to warm up. Residuals of neighbouring samples are correlated, so the
standard error of the slope is that of least squares times sqrt((1 + r) / (1 - r)), r their
correlation.
"""

import argparse
import itertools
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
import psutil

from benchmarks.lib.system import Cluster, Listener, cluster
from benchmarks.lib.table import markdown, quantiles, write
from benchmarks.replicas import RECORDED_HZ, SOURCE, TIMEOUT_S, play
from people4d.client import Client
from people4d.messages import Health, Tracks

T = TypeVar("T")

SHARED_MEMORY = Path("/dev/shm")
OVERLOAD = 2.0
WARM_UP_SHARE = 0.2  # of the time, left out of the fit
SAMPLES = 360  # in the whole time, at most one a second
PARTS = 4  # of the time, whose latencies are compared
LOSSES = ("dropped_", "gaps_", "stale", "duplicates", "missing", "embedding_timeouts", "errors")


@dataclass
class ProcessSamples:
    """Samples of one process.

    Args:
        times_s: When, monotonic.
        memory_mb: Memory that is this process's alone.
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
                samples.memory_mb.append(process.memory_full_info().uss / 2**20)
                samples.descriptors.append(process.num_fds())
            mapped = set[str]().union(*map(_shared_files, self._processes.values()))
            self.shared_mb.append(sum(_size_mb(Path(file)) for file in mapped))


def slope(times_s: Sequence[float], values: Sequence[float]) -> tuple[float, float]:
    """Return the slope of a line through values per hour, and its standard error."""
    hours = np.array(times_s) / 3600
    hours -= hours.mean()
    centred = np.array(values) - np.mean(values)
    rise = float(hours @ centred / (hours @ hours))
    residuals = centred - rise * hours
    error = np.sqrt(residuals @ residuals / max(len(hours) - 2, 1) / (hours @ hours))
    power = float(residuals @ residuals)
    alike = float(residuals[1:] @ residuals[:-1]) / power if power > 0 else 0.0
    alike = min(max(alike, 0.0), 0.99)
    return rise, float(error * np.sqrt((1 + alike) / (1 - alike)))


@dataclass
class Soak:
    """Results of one long run.

    Args:
        rate_hz: Frames sent per second.
        observer: Memory, descriptors, shared memory.
        latencies_ms: Pairs of monotonic time and latency of every frame whose people came.
        healths: Last heartbeat of each process.
    """

    rate_hz: float
    observer: Observer
    latencies_ms: list[tuple[float, float]]
    healths: dict[str, Health]


def soak(model: str, detectors: int, minutes: float, frames: int) -> tuple[float, Soak]:
    """Measure the sustainable rate, then send twice as many frames for a time."""
    sustainable_hz = play(model, detectors, frames).rate_hz
    rate_hz = OVERLOAD * sustainable_hz
    print(f"sustainable: {sustainable_hz:.1f} frames per second", flush=True)
    with (
        tempfile.TemporaryDirectory() as logs,
        cluster(Path(logs)) as system,
        Listener(system.endpoint) as client,
    ):
        names = ["tracker-1", "reid-1", *(f"detector-{k + 1}" for k in range(detectors))]
        for name in names:
            service = name.partition("-")[0]
            system.start(service, name, (f"model={model}",) if service == "detector" else ())
        system.wait_ready(client, set(names))
        camera = (f"source={SOURCE}", "loop=true", f"speed={rate_hz / RECORDED_HZ}")
        system.start("camera", "camera-1", camera)
        return sustainable_hz, _observed(system, client, minutes * 60, rate_hz)


def _observed(system: Cluster, client: Client, duration_s: float, rate_hz: float) -> Soak:
    pids = {name: process.pid for name, process in system.processes.items()}
    observer = Observer(pids, max(duration_s / SAMPLES, 1.0))
    latencies_ms: list[tuple[float, float]] = []
    healths: dict[str, Health] = {}
    end_s, last = time.monotonic() + duration_s, -1
    for message in client.messages(Tracks, Health, timeout_s=TIMEOUT_S):
        now_s = time.monotonic()
        if isinstance(message, Health):
            healths[message.instance] = message
        elif message.sequence > last and message.trace:
            last = message.sequence
            latency_ns = time.time_ns() - message.trace[0].start_ns
            latencies_ms.append((now_s, latency_ns / 1e6))
        if now_s > end_s:
            break
    observer.close()
    return Soak(rate_hz, observer, latencies_ms, healths)


def report(sustainable_hz: float, run: Soak) -> list[str]:
    """Return the tables."""
    times_s = [time_s for time_s, _ in run.latencies_ms]
    done_hz = len(times_s) / (times_s[-1] - times_s[0])
    sent_hz = run.healths["camera-1"].counters["sent_frames"] / (times_s[-1] - times_s[0])
    edges = np.linspace(times_s[0], times_s[-1], PARTS + 1)
    latency_rows = []
    for begin_s, end_s in itertools.pairwise(edges):
        part = [ms for time_s, ms in run.latencies_ms if begin_s <= time_s <= end_s]
        minutes = f"{(begin_s - times_s[0]) / 60:.1f} to {(end_s - times_s[0]) / 60:.1f}"
        latency_rows.append([minutes, str(len(part)), *quantiles(part), f"{max(part):.0f}"])
    rows = [_grown(name, samples) for name, samples in run.observer.samples.items()]
    shared = _after_warm_up(run.observer.shared_mb)
    losses = [
        [name, cause, str(count)]
        for name, health in sorted(run.healths.items())
        for cause, count in sorted(health.counters.items())
        if count and cause.startswith(LOSSES)
    ]
    return [
        f"Sustainable: {sustainable_hz:.1f} frames per second. Wanted of the camera: "
        f"{run.rate_hz:.1f}, sent: {sent_hz:.1f}; people came for {done_hz:.1f} a second.",
        "## Latency",
        "From the frame being sent to its people in a subscriber's hands.",
        markdown(["minutes", "frames", "p50 ms", "p95 ms", "p99 ms", "longest ms"], latency_rows),
        "## Growth",
        markdown(["process", "memory [MB]", "slope [MB/h]", "file descriptors"], rows),
        f"Files in /dev/shm that these processes held: {shared[0]:.1f} MB after the warm-up, "
        f"{shared[-1]:.1f} MB at the end (least {min(shared):.1f}, most {max(shared):.1f}).",
        "## What was dropped, by cause",
        markdown(["process", "cause", "count"], losses),
    ]


def _grown(name: str, samples: ProcessSamples) -> list[str]:
    times_s, memory_mb = _after_warm_up(samples.times_s), _after_warm_up(samples.memory_mb)
    rise, error = slope(times_s, memory_mb)
    descriptors = _after_warm_up(samples.descriptors)
    return [
        name,
        f"{np.median(memory_mb):.1f}",
        f"{rise:+.1f} ± {error:.1f}",
        f"{descriptors[0]} to {descriptors[-1]} (most {max(descriptors)})",
    ]


def _after_warm_up(values: list[T]) -> list[T]:
    return values[int(WARM_UP_SHARE * len(values)) :]


def _shared_files(process: psutil.Process) -> set[str]:
    """Return the files in shared memory that a process has mapped."""
    lines = Path(f"/proc/{process.pid}/maps").read_text(encoding="utf-8").splitlines()
    return {line.split()[-1] for line in lines if f" {SHARED_MEMORY}/" in line}


def _size_mb(file: Path) -> float:
    try:
        return file.stat().st_size / 2**20
    except FileNotFoundError:  # it was there a moment ago
        return 0.0


def main() -> None:
    """Run as long as the command line says."""
    parser = argparse.ArgumentParser(description="Run at twice the sustainable rate.")
    parser.add_argument("model", nargs="?", default="movenet-multipose")
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--detectors", type=int, default=2)
    parser.add_argument("--frames", type=int, default=200, help="to find the sustainable rate")
    flags = parser.parse_args()
    sustainable_hz, run = soak(flags.model, flags.detectors, flags.minutes, flags.frames)
    write(
        __file__,
        f"Soak: {flags.minutes:g} minutes at twice the sustainable rate",
        f"{Path(flags.model).stem}, {flags.detectors} detectors of one thread, 640x480, the "
        "shipped recording in a loop, from memory. Memory is what only that process has; its slope "
        f"is fitted after the first {WARM_UP_SHARE:.0%} of the time, with the standard error.",
        *report(sustainable_hz, run),
    )


if __name__ == "__main__":
    main()
