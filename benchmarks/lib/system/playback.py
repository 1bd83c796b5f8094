"""Playback through the pipeline: frames a second, processor time, memory, paths of frames."""

import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil

from benchmarks.lib.system.live_camera import LiveDemo, StoredDemo
from benchmarks.lib.system.services import running
from common.inference.cores import VARIABLE
from common.inference.onnx import OnnxSession
from common.io.weights import choose, find, folders, load_manifest
from common.runtime.monitor import FramePath, Monitor
from common.transport.trace import ProcessId
from people4d.messages import Detections, Tracks
from services.detector.config import ModelSettings
from services.detector.models.network import ImageInput

WARM_UP = 30  # number of frames before the measurement
INFERENCE = ("inference", "inference_wait")
BARE_S = 4.0
BARE_SIZE = (256, 320)  # [px] input of a network with any size


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
    memory_mb: float  # proportional set size of all processes
    paths: list[FramePath]  # path of every frame to the subscriber; empty without tracing
    end_to_end_ms: list[float]  # [ms] from the camera's stamp to the subscriber

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
        "loop=true",
        "playback=lockstep",
        "window=2",
        f"max_frames={frames + 2 * WARM_UP}",
    )


def live(rate_hz: float) -> tuple[str, ...]:
    """Return the camera's settings for the same images at a rate, stamped by the clock."""
    return (f"source={LiveDemo.__module__}:{LiveDemo.__name__}", f"options.rate_hz={rate_hz:.2f}")


def play(
    camera: Sequence[str],
    frames: int,
    model: Sequence[str] = (),
    one: Arrangement = APART,
    cameras: int = 1,
) -> Playback:
    """Run the system once.

    Args:
        camera: Settings of the camera.
        frames: Frames to measure, after those for warming up.
        model: Settings of the detector.
        one: Its processes and cores.
        cameras: Number of such cameras.
    """
    named = [("camera", (*camera, f"camera=c{k}")) for k in range(cameras)]
    services = [("tracker", ()), ("reid", ()), ("detector", model), *named]
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
        for arrival in client.arrivals(Tracks, Detections, timeout_s=30):
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
        rate_hz = frames / (time.perf_counter() - begin_s)
        cpu_ms = 1e3 * (_cpu_s() - begin_cpu_s) / frames
        pss = [child.memory_full_info().pss for child in psutil.Process().children()]
    return Playback(rate_hz, cpu_ms, sum(pss) / 2**20, paths, end_to_end_ms)


def bare_hz(model: str, seconds: float = BARE_S) -> float:
    """Return runs a second of a network alone, in one thread.

    Args:
        model: Name in the manifest, or path of an .onnx file.
        seconds: Time to measure.
    """
    path = Path(model)
    if path.suffix != ".onnx":
        path = find(choose(model, load_manifest()), folders(""))
    session = OnnxSession(path, threads=1)
    image = ImageInput.from_session(session, ModelSettings(), BARE_SIZE)
    tensor = image.tensor(np.full((image.height, image.width, 3), 114, np.uint8), 1.0)
    session.run(tensor)
    runs, start_s = 0, time.perf_counter()
    while time.perf_counter() - start_s < seconds:
        session.run(tensor)
        runs += 1
    return runs / (time.perf_counter() - start_s)


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
