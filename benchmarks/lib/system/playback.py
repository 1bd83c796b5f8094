"""Playback through the pipeline: frames a second, processor time, memory, paths of frames."""

import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import psutil

from benchmarks.lib.system.bare import INFERENCE
from benchmarks.lib.system.live_camera import LiveDemo, StoredDemo, frames_file
from benchmarks.lib.system.services import READY_S, running
from common.inference.cores import VARIABLE
from common.runtime.monitor import FramePath, Monitor
from common.transport.trace import ProcessId
from people4d.messages import Detections, Tracks

STARTS = (
    "services.camera.__main__",
    "services.detector.__main__",
    "services.reid.__main__",
    "services.tracker.__main__",
)
WARM_UP = 30  # number of frames before the measurement


class Arrangement(NamedTuple):
    """Processes and cores of the system."""

    together: bool = False  # True: one process for all services except the router
    reserved: bool = False  # True: one core for the detector's network only

    def __str__(self) -> str:
        """Return the arrangement in words."""
        name = "together" if self.together else "apart"
        return f"{name}, a core for the detector" if self.reserved else name


APART, TOGETHER = Arrangement(), Arrangement(together=True)


@dataclass(frozen=True)
class Playback:
    """One run of the system."""

    rate_hz: float  # tracked frames a second
    cpu_ms: float  # processor time of all processes for one frame
    memory_mb: dict[str, float]  # proportional set size of each process by instance
    paths: list[FramePath]  # path of every frame to the subscriber; empty if tracing is off
    end_to_end_ms: list[float]  # [ms] time from the camera's stamp to the subscriber

    @property
    def others_ms(self) -> list[float]:
        """Return the time of each frame in all stages except inference [ms]."""
        return [
            sum(part.ms for part in path.parts if part.stage not in INFERENCE)
            for path in self.paths
        ]


def lockstep(frames: int) -> tuple[str, ...]:
    """Return the camera's settings for the shipped recording from memory, in lock-step."""
    source = f"source={StoredDemo.__module__}:{StoredDemo.__name__}"
    return (
        source,
        f"options.path={frames_file(75)}",
        "loop=true",
        "playback=lockstep",
        "window=2",
        f"max_frames={frames + 2 * WARM_UP}",
    )


def live(rate_hz: float) -> tuple[str, ...]:
    """Return the camera's settings for the same images at a rate, stamped by the clock."""
    source = f"source={LiveDemo.__module__}:{LiveDemo.__name__}"
    return source, f"options.path={frames_file(24, 5)}", f"options.rate_hz={rate_hz:.2f}"


def play(
    camera: Sequence[str],
    frames: int,
    model: Sequence[str] = (),
    one: Arrangement = APART,
    cameras: int = 1,
    detectors: int = 1,
) -> Playback:
    """Run the system once.

    TimeoutError if the system stopped, or did not start.

    Args:
        camera: Settings of the camera.
        frames: Number of measured frames, after the warm-up.
        model: Settings of the detector.
        one: Processes and cores of the system.
        cameras: Number of cameras.
        detectors: Number of detectors, which share the frames.
    """
    named = [("camera", (*camera, f"camera=c{k}")) for k in range(cameras)]
    services = [("tracker", ()), ("reid", ()), *[("detector", model)] * detectors, *named]
    monitor, warm_up = (
        Monitor(ProcessId("subscriber", "subscriber", "here"), 1.0),
        WARM_UP * cameras,
    )
    paths, end_to_end_ms = list[FramePath](), list[float]()
    count, begin_s, begin_cpu_s = 0, 0.0, 0.0
    with (
        tempfile.TemporaryDirectory() as logs,
        _reserving(one.reserved),
        running(services, Path(logs), together=one.together) as client,
        _leaving_core(one.reserved),
    ):
        for arrival in client.arrivals(Tracks, Detections, timeout_s=READY_S):
            now_ns, message = time.time_ns(), arrival.message
            path = monitor.add_arrival(arrival, now_ns, time.monotonic())
            if not isinstance(message, Tracks) or (message.trace and not path):
                continue  # predictions have no frame
            count += 1
            if count == warm_up:
                begin_s, begin_cpu_s = time.perf_counter(), _cpu_s()
            if count > warm_up and path:
                paths.append(path)
                end_to_end_ms.append((now_ns - message.stamp_ns) / 1e6)
            if count == warm_up + frames:
                break
        else:
            raise TimeoutError(f"{count} of {warm_up + frames} frames, then none for {READY_S} s")
        rate_hz = frames / (time.perf_counter() - begin_s)
        cpu_ms = 1e3 * (_cpu_s() - begin_cpu_s) / frames
        memory_mb = _memory_mb()
    return Playback(rate_hz, cpu_ms, memory_mb, paths, end_to_end_ms)


@contextmanager
def _reserving(reserved: bool) -> Iterator[None]:
    """Reserve the last core for the detector of processes started in a block, if wanted."""
    os.environ[VARIABLE] = str(max(os.sched_getaffinity(0))) if reserved else ""
    try:
        yield
    finally:
        del os.environ[VARIABLE]


@contextmanager
def _leaving_core(reserved: bool) -> Iterator[None]:
    """Move this thread, which stands for a planner, off the reserved core in a block."""
    cores = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, cores - {max(cores)} if reserved else cores)
        yield
    finally:
        os.sched_setaffinity(0, cores)


def _cpu_s() -> float:
    """Return the processor time of this process's children so far [s]."""
    times = [child.cpu_times() for child in psutil.Process().children()]
    return sum(t.user + t.system for t in times)


def _memory_mb() -> dict[str, float]:
    """Return the proportional set size of this process's children by instance [MB]."""
    found = {}
    for child in psutil.Process().children():
        _, _, instance = " ".join(child.cmdline()).partition("--instance ")
        found[instance.partition(" ")[0]] = child.memory_full_info().pss / 2**20
    return found
