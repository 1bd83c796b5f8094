"""Services together in one process beside the same ones apart: rate, latency and memory.

Both with all cores for all threads, and with one core reserved for the detector's network. Rate and
processor time: lock-step playback from memory, two frames in flight, rounds by turns, beside
`session.run` of onnxruntime alone, in one thread. Latency of all that is not inference: a live
camera at 60 % of the rate of each, and at 30 Hz. Memory: proportional set size of all processes,
the router included.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil

from benchmarks.latency import INFERENCE, cpu_s, live
from benchmarks.lib.live_camera import StoredDemo
from benchmarks.lib.system import running
from benchmarks.lib.table import markdown, spread, write
from benchmarks.pipeline import bare_hz
from common.inference.cores import VARIABLE
from common.runtime.latency import percentiles
from common.runtime.monitor import FramePath, Monitor
from common.transport.trace import ProcessId
from people4d.messages import Detections, Tracks

WARM_UP = 30
RATE_SHARE = 0.6
BARE_S = 4.0
BUSY = (
    "**Other programs used the machine by turns: rates and times are worse than they are, by "
    "factors that differ from run to run, and do not compare. Memory does.**"
)
LIMITS_MS = {True: (5.0, 10.0), False: (8.0, 15.0)}  # together or apart: p50 and p99


class Arrangement(NamedTuple):
    """Processes and cores of the system."""

    together: bool  # one process for all but the router
    reserved: bool  # one core for the detector's network, the others for all else

    def __str__(self) -> str:
        """Return it in words."""
        name = "together" if self.together else "apart"
        return f"{name}, a core for the detector" if self.reserved else name


ARRANGEMENTS = [Arrangement(one, reserved) for reserved in (False, True) for one in (True, False)]


@dataclass(frozen=True)
class Playback:
    """One run of the system."""

    rate_hz: float  # frames a second
    others_ms: list[float]  # time of each frame in all but inference
    age_ms: list[float]  # time of each frame from the image to the subscriber
    memory_mb: float  # proportional set size of all processes
    cpu_ms: float  # processor time of all processes for one frame


@dataclass
class Figures:
    """Figures of one arrangement, over its rounds."""

    rates_hz: list[float] = field(default_factory=list)
    ratios: list[float] = field(default_factory=list)  # of the rate to that of the bare network
    cpu_ms: list[float] = field(default_factory=list)
    others_ms: dict[str, list[float]] = field(default_factory=dict)  # by rate, of every frame
    memory_mb: list[float] = field(default_factory=list)


def others_ms(path: FramePath) -> float:
    """Return the time of a frame in all stages but inference [ms]."""
    return sum(part.ms for part in path.parts if part.stage not in INFERENCE)


@contextmanager
def reserving(reserved: bool) -> Iterator[None]:
    """Have processes started in a block reserve the last core for the detector, or none."""
    os.environ[VARIABLE] = str(max(os.sched_getaffinity(0))) if reserved else ""
    try:
        yield
    finally:
        del os.environ[VARIABLE]


def play(one: Arrangement, model: Sequence[str], camera: Sequence[str], frames: int) -> Playback:
    """Run the system once.

    Args:
        one: Its processes and cores.
        model: Settings of the detector.
        camera: Settings of the camera.
        frames: Frames to measure, after those for warming up.
    """
    services = [("tracker", ()), ("reid", ()), ("detector", model), ("camera", camera)]
    monitor = Monitor(ProcessId("subscriber", "subscriber", "here"), 1.0)
    count, begin_s, begin_cpu_s = 0, 0.0, 0.0
    times_ms, age_ms = list[float](), list[float]()
    with (
        tempfile.TemporaryDirectory() as logs,
        reserving(one.reserved),
        running(services, Path(logs), together=one.together) as client,
    ):
        for arrival in client.arrivals(Tracks, Detections, timeout_s=30):
            path = monitor.add(arrival, time.time_ns(), time.monotonic())
            message = arrival.message
            if not isinstance(message, Tracks) or (message.trace and not path):
                continue  # a prediction is of no frame
            count += 1
            if count == WARM_UP:
                begin_s, begin_cpu_s = time.perf_counter(), cpu_s()
            if count > WARM_UP and path:
                times_ms.append(others_ms(path))
                age_ms.append(path.end_to_end.ms)
            if count == WARM_UP + frames:
                break
        rate_hz = (count - WARM_UP) / (time.perf_counter() - begin_s)
        cpu_ms = 1e3 * (cpu_s() - begin_cpu_s) / (count - WARM_UP)
        pss = [child.memory_full_info().pss for child in psutil.Process().children()]
    return Playback(rate_hz, times_ms, age_ms, sum(pss) / 2**20, cpu_ms)


def lockstep(frames: int) -> tuple[str, ...]:
    """Return the camera's settings for the shipped recording, as fast as it goes."""
    source = f"source={StoredDemo.__module__}:{StoredDemo.__name__}"
    last = f"max_frames={frames + WARM_UP + 5}"
    return (source, "loop=true", "playback=lockstep", "window=2", last)


def beside_a_loop_hz(name: str) -> float:
    """Return runs per second of the network alone on the last core, a loop of Python on the first.

    Where both are threads of one physical core, that is all that a pipeline can leave to a network.
    """
    cores = os.sched_getaffinity(0)
    loop = f"import os; os.sched_setaffinity(0, {{{min(cores)}}})\nwhile True: pass"
    with subprocess.Popen([sys.executable, "-c", loop]) as beside:
        os.sched_setaffinity(0, {max(cores)})
        try:
            return bare_hz(name, BARE_S)
        finally:
            os.sched_setaffinity(0, cores)
            beside.kill()


def measure(
    model: Sequence[str], rounds: int, frames: int
) -> tuple[list[float], dict[Arrangement, Figures]]:
    """Measure all arrangements by turns; return the ratios beside a loop, and their figures."""
    found, shared = {one: Figures() for one in ARRANGEMENTS}, list[float]()
    (name,) = (text.partition("=")[2] for text in model if text.startswith("model="))
    for number in range(rounds):
        bare = bare_hz(name, BARE_S)
        shared.append(beside_a_loop_hz(name) / bare)
        for one in ARRANGEMENTS if number % 2 == 0 else reversed(ARRANGEMENTS):
            print(f"rate, round {number + 1} of {rounds}, {one}", flush=True)
            run = play(one, model, lockstep(frames), frames)
            found[one].rates_hz.append(run.rate_hz)
            found[one].ratios.append(run.rate_hz / bare)
            found[one].cpu_ms.append(run.cpu_ms)
    for one, figures in found.items():
        share_hz = RATE_SHARE * float(np.median(figures.rates_hz))
        for load, rate_hz in ((f"{RATE_SHARE:.0%} load", share_hz), ("30 Hz", 30.0)):
            print(f"{load}, {rate_hz:.1f} Hz, {one}", flush=True)
            run = play(one, model, live(rate_hz), frames)
            figures.others_ms[f"{load}, {run.rate_hz:.1f} frames/s"] = run.others_ms
            figures.memory_mb.append(run.memory_mb)
    return shared, found


def rows(shared: Sequence[float], figures: dict[Arrangement, Figures]) -> list[list[str]]:
    """Return the rows of the table."""
    found = [["bare, a loop on the other core", "", "of the bare network", spread(shared), ""]]
    for one, measured in figures.items():
        name = str(one)
        rate = spread(measured.rates_hz, "{:.1f}")
        found.append([name, "lock-step", "frames a second", rate, ""])
        found.append([name, "lock-step", "of the bare network", spread(measured.ratios), ""])
        cpu = spread(measured.cpu_ms, "{:.1f}")
        found.append([name, "lock-step", "processor ms a frame", cpu, ""])
        for load, times_ms in measured.others_ms.items():
            p50, _, p99 = percentiles(times_ms)
            limit = "wanted: {:g} and {:g}".format(*LIMITS_MS[one.together])
            found.append([name, load, "all but inference", f"{p50:.1f}, {p99:.1f} ms", limit])
        memory = f"{np.median(measured.memory_mb):.0f} MB"
        found.append([name, "live", "memory with the router", memory, ""])
    return found


def main() -> None:
    """Measure with the models named on the command line."""
    parser = argparse.ArgumentParser(description="Measure services together and apart.")
    parser.add_argument(
        "detectors",
        nargs="*",
        default=["model=movenet-multipose"],
        help="settings of the detector with commas between: model=...,engine=openvino",
    )
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--busy", action="store_true", help="say that other programs ran, too")
    flags = parser.parse_args()
    sections = []
    for texts in flags.detectors:
        table = rows(*measure(texts.split(","), flags.rounds, flags.frames))
        sections.append(f"## Detector: {texts.replace(',', ', ')}")
        sections.append(
            markdown(["", "load", "", "median (spread), or p50 and p99", "wanted"], table)
        )
    write(
        __file__,
        "Services together in one process, and apart",
        "Camera, detector, re-ID and tracker, in one process or in four, and a subscriber to "
        "people and detections through the router; 640x480, three people, played from memory, one "
        "network thread. The bare network is `session.run` of onnxruntime alone in one thread, in "
        "the same round; beside a loop of Python on the other core it shows how far the cores are "
        "one. With a core for the detector: `PEOPLE4D_DETECTOR_CORES` names the last one. "
        "See [docs/launch/together.md](../docs/launch/together.md).",
        *([BUSY] if flags.busy else []),
        *sections,
    )


if __name__ == "__main__":
    main()
