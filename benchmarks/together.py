"""Services together in one process beside the same services apart: rate, latency and memory.

Both with all cores for all threads, and with one core reserved for the detector's network. Rate and
processor time: lock-step playback from memory, two frames in flight, rounds in turns, beside
`session.run` of onnxruntime alone in one thread. Latency of all stages but inference: a live camera
at 60 % of the rate of each, and at 30 Hz. Memory: proportional set size of all processes and the
router.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.lib import options
from benchmarks.lib.system.playback import Arrangement, bare_hz, live, lockstep, play
from benchmarks.lib.table import markdown, spread, write
from common.runtime.latency import percentiles

RATE_SHARE = 0.6
LIMITS_MS = {True: (5.0, 10.0), False: (8.0, 15.0)}  # together or apart: p50 and p99


ARRANGEMENTS = [Arrangement(one, reserved) for reserved in (False, True) for one in (True, False)]


@dataclass
class Figures:
    """Figures of one arrangement, over its rounds."""

    rates_hz: list[float] = field(default_factory=list)
    ratios: list[float] = field(default_factory=list)  # rate over the rate of the bare network
    cpu_ms: list[float] = field(default_factory=list)
    others_ms: dict[str, list[float]] = field(default_factory=dict)  # times of all frames by rate
    memory_mb: list[float] = field(default_factory=list)


def measure(model: Sequence[str], rounds: int, frames: int) -> dict[Arrangement, Figures]:
    """Measure all arrangements in turns."""
    found = {one: Figures() for one in ARRANGEMENTS}
    (name,) = (text.partition("=")[2] for text in model if text.startswith("model="))
    for number in range(rounds):
        bare = bare_hz(name)
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
    return found


def rows(figures: dict[Arrangement, Figures]) -> list[list[str]]:
    """Return the rows of the table."""
    found = []
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
    flags = parser.parse_args()
    sections = []
    for texts in flags.detectors:
        table = rows(measure(texts.split(","), flags.rounds, flags.frames))
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
        "the same round. With a core for the detector: `PEOPLE4D_DETECTOR_CORES` names the last "
        "core, and the subscriber does not use it. "
        "See [docs/launch/together.md](../docs/launch/together.md).",
        *sections,
    )
