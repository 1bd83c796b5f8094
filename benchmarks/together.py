"""Services in one process, compared with separate processes: rate, latency and memory.

Each arrangement runs with all cores for all threads, and with one core reserved for the detector's
network. Each round measures every arrangement: rate and processor time in lock-step playback from
memory, two frames in flight; all stages but inference with a live camera at 60 % of that rate, and
at 30 Hz. The references in each round are the same network and the float network, each alone in
one thread.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.lib import options
from benchmarks.lib.system.bare import FLOAT, bare_ms
from benchmarks.lib.system.playback import Arrangement, Playback, live, lockstep, play
from benchmarks.lib.system.stages import stage_tables
from benchmarks.lib.table import markdown, spread, write
from common.runtime.latency import percentiles

FRAMES, QUICK_FRAMES = 150, 20
RATE_SHARE, RATE_HZ = 0.6, 30.0
SHARE_LOAD, RATE_LOAD = f"{RATE_SHARE:.0%} load", f"{RATE_HZ:.0f} Hz"
# Wanted, together and apart: share of the bare rate with the float network and in 8 bits; p50 and
# p99 of all but inference as a multiple of a run of the float network; memory [MB]
SHARES = {True: (0.97, 0.85), False: (0.93, 0.70)}
MULTIPLES = {True: (0.40, 0.80), False: (0.55, 1.10)}
MEMORY_MB = {True: 280, False: 400}
CAMERA_MB = 150
ARRANGEMENTS = [Arrangement(one, reserved) for reserved in (False, True) for one in (True, False)]

Key = tuple[str, str, str]  # arrangement, load, figure


@dataclass
class Figures:
    """Figures of a detector over the rounds."""

    values: dict[Key, list[float]] = field(default_factory=lambda: defaultdict(list))
    wanted: dict[Key, str] = field(default_factory=dict)
    paced: list[Playback] = field(default_factory=list)  # apart, at a share of the rate

    def add(self, key: Key, value: float, wanted: str = "") -> None:
        """Add the figure of a round."""
        self.values[key].append(value)
        self.wanted[key] = wanted

    def rows(self) -> list[list[str]]:
        """Return the rows of the table."""
        rows = []
        for key, values in self.values.items():
            form = "{:.2f}" if " of " in key[2] else "{:.1f}"
            rows.append([*key, spread(values, form), self.wanted[key]])
        return rows


def add_round(
    figures: Figures, detector: Sequence[str], one: Arrangement, bare: tuple[float, float], n: int
) -> None:
    """Measure an arrangement once.

    Args:
        figures: Figures to add to.
        detector: Settings of the detector.
        one: Arrangement.
        bare: Time of a run of the network, and of the float network [ms].
        n: Number of frames.
    """
    name, own_ms, float_ms = str(one), *bare
    fast = play(lockstep(n), n, detector, one)
    share = SHARES[one.together][f"model={FLOAT}" not in detector]
    figures.add((name, "lock-step", "frames a second"), fast.rate_hz)
    rate_share = fast.rate_hz * own_ms / 1e3
    wanted = "" if one.reserved else f"at least {share:.2f}"
    figures.add((name, "lock-step", "part of the bare network"), rate_share, wanted)
    figures.add((name, "lock-step", "processor ms a frame"), fast.cpu_ms)
    loads = {SHARE_LOAD: RATE_SHARE * fast.rate_hz, RATE_LOAD: RATE_HZ}
    for load in (SHARE_LOAD,) if one.reserved else loads:
        run = play(live(loads[load]), n, detector, one)
        add_live(figures, one, load, run, float_ms)
        if one == Arrangement() and load == SHARE_LOAD:
            figures.paced.append(run)


def add_live(figures: Figures, one: Arrangement, load: str, run: Playback, float_ms: float) -> None:
    """Add latency and memory of a live run."""
    p50, _, p99 = percentiles(run.others_ms)
    for name, ms, limit in zip(("p50", "p99"), (p50, p99), MULTIPLES[one.together], strict=True):
        wanted = "" if one.reserved else f"at most {limit:.2f}"
        title = f"all but inference, {name}"
        figures.add((str(one), load, f"{title} [ms]"), ms)
        figures.add((str(one), load, f"{title}, part of a float run"), ms / float_ms, wanted)
    if load == RATE_LOAD:
        memory = sum(run.memory_mb.values())
        wanted = f"at most {MEMORY_MB[one.together]}"
        figures.add((str(one), load, "memory with the router [MB]"), memory, wanted)
        if not one.together:
            camera = run.memory_mb["camera-1"]
            figures.add((str(one), load, "camera's memory [MB]"), camera, f"at most {CAMERA_MB}")


def measure(detectors: Sequence[str], rounds: int, frames: int) -> dict[str, Figures]:
    """Measure all detectors and arrangements alternately."""
    found = {detector: Figures() for detector in detectors}
    for number in range(rounds):
        for detector, figures in found.items():
            settings = detector.split(",")
            (model,) = (text.partition("=")[2] for text in settings if text.startswith("model="))
            bare = bare_ms(model), bare_ms(FLOAT)
            for one in ARRANGEMENTS if number % 2 == 0 else reversed(ARRANGEMENTS):
                print(f"round {number + 1} of {rounds}, {model}, {one}", flush=True)
                add_round(figures, settings, one, bare, frames)
    return found


def main() -> None:
    """Measure with the models named on the command line."""
    parser = options.parser(__doc__, "rounds", "quick")
    parser.add_argument(
        "detectors",
        nargs="*",
        default=[f"model={FLOAT}", f"model={FLOAT}-int8"],
        help="comma-separated settings of the detector: model=...,engine=openvino",
    )
    asked = parser.parse_args()
    rounds, frames = (1, QUICK_FRAMES) if asked.quick else (asked.rounds, FRAMES)
    found = measure(asked.detectors, rounds, frames)
    header = ("", "load", "", "median (least to most)", "wanted")
    sections = list[str]()
    for detector, figures in found.items():
        title = f"## Detector: {detector.replace(',', ', ')}"
        sections += [title, markdown(header, figures.rows())]
    paced = found[asked.detectors[-1]].paced
    paths = [path for run in paced for path in run.paths]
    tables = stage_tables(paths, [ms for run in paced for ms in run.end_to_end_ms])
    rate_hz = np.median([run.rate_hz for run in paced])
    write(
        __file__,
        "Services together in one process, and apart",
        "Camera, detector, re-ID and tracker, in one process or in four, and a subscriber to "
        "people and detections through the router; 640x480, three people, played from memory, one "
        f"network thread; {rounds} rounds of {frames} frames. The bare network is `session.run` of "
        "onnxruntime alone in one thread, in the same round; a float run is one of "
        f"`{FLOAT}`. With a core for the detector: `PEOPLE4D_DETECTOR_CORES` names the last core, "
        "and the subscriber does not use it. Memory: proportional set size; the camera holds 24 "
        "frames, 37 MB, and does not simulate a depth sensor, which needs 80 MB.",
        *sections,
        f"## Stages of a frame: {asked.detectors[-1]}, apart, {SHARE_LOAD}, {rate_hz:.1f} Hz",
        "Stages are explained in [docs/operation/latency.md](../docs/operation/latency.md). A hop "
        "(`transport`) of an image of 1.5 MB reaches the detector on a loaded computer. Published "
        "hops, p50 on other, idle computers: [eCAL](https://eclipse-ecal.github.io/ecal/advanced/"
        "performance.html) 0.18 ms for 1 MB and 0.32 ms for 2 MB, without a copy 0.003 ms; "
        "[dora](https://github.com/dora-rs/dora-benchmark) 0.32 ms in Python.",
        *tables,
        dry=asked.quick,
    )
