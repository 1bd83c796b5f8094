"""Services together in one process beside the same ones apart: rate, latency and memory.

Both with all cores for all threads, and with one core reserved for the detector's network. Rate and
processor time: lock-step playback from memory, two frames in flight, rounds by turns, beside
`session.run` of onnxruntime alone, in one thread. Latency of all that is not inference: a live
camera at 60 % of the rate of each, and at 30 Hz. Memory: proportional set size of all processes,
the router included.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.lib import options
from benchmarks.lib.system.playback import Arrangement, bare_hz, live, lockstep, play
from benchmarks.lib.table import markdown, spread, write
from common.runtime.latency import percentiles

RATE_SHARE = 0.6
BUSY = (
    "**Other programs used the machine by turns: rates and times are worse than they are, by "
    "factors that differ from run to run, and do not compare. Memory does.**"
)
LIMITS_MS = {True: (5.0, 10.0), False: (8.0, 15.0)}  # together or apart: p50 and p99


ARRANGEMENTS = [Arrangement(one, reserved) for reserved in (False, True) for one in (True, False)]


@dataclass
class Figures:
    """Figures of one arrangement, over its rounds."""

    rates_hz: list[float] = field(default_factory=list)
    ratios: list[float] = field(default_factory=list)  # of the rate to that of the bare network
    cpu_ms: list[float] = field(default_factory=list)
    others_ms: dict[str, list[float]] = field(default_factory=dict)  # by rate, of every frame
    memory_mb: list[float] = field(default_factory=list)


def beside_a_loop_hz(name: str) -> float:
    """Return runs per second of the network alone on the last core, a loop of Python on the first.

    Where both are threads of one physical core, that is all that a pipeline can leave to a network.
    """
    cores = os.sched_getaffinity(0)
    loop = f"import os; os.sched_setaffinity(0, {{{min(cores)}}})\nwhile True: pass"
    with subprocess.Popen([sys.executable, "-c", loop]) as beside:
        os.sched_setaffinity(0, {max(cores)})
        try:
            return bare_hz(name)
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
        bare = bare_hz(name)
        shared.append(beside_a_loop_hz(name) / bare)
        for one in ARRANGEMENTS if number % 2 == 0 else reversed(ARRANGEMENTS):
            print(f"rate, round {number + 1} of {rounds}, {one}", flush=True)
            run = play(lockstep(frames), frames, model, one)
            found[one].rates_hz.append(run.rate_hz)
            found[one].ratios.append(run.rate_hz / bare)
            found[one].cpu_ms.append(run.cpu_ms)
    for one, figures in found.items():
        share_hz = RATE_SHARE * float(np.median(figures.rates_hz))
        for load, rate_hz in ((f"{RATE_SHARE:.0%} load", share_hz), ("30 Hz", 30.0)):
            print(f"{load}, {rate_hz:.1f} Hz, {one}", flush=True)
            run = play(live(rate_hz), frames, model, one)
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
    parser = options.parser(__doc__)
    parser.add_argument(
        "detectors",
        nargs="*",
        default=["model=movenet-multipose", "model=movenet-multipose-int8"],
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
        "one. With a core for the detector: `PEOPLE4D_DETECTOR_CORES` names the last one, and the "
        "subscriber leaves it, too. "
        "See [docs/launch/together.md](../docs/launch/together.md).",
        *([BUSY] if flags.busy else []),
        *sections,
    )
