"""Rate, processor time and latency by the number of people, of cameras and of detectors.

Camera, detector, re-ID and tracker as processes with one network thread. People: copies of
detected people. Cameras: live, 15 frames a second each, on one detector. Detectors: one camera in
lock-step, with two frames in flight for each detector.
"""

from collections import defaultdict

import numpy as np

from benchmarks.lib import options
from benchmarks.lib.system.bare import bare_ms
from benchmarks.lib.system.crowd import Crowd
from benchmarks.lib.system.playback import live, lockstep, play
from benchmarks.lib.table import markdown, spread, write
from common.runtime.latency import percentiles
from services.detector.config import shipped_model

MODEL = shipped_model()
PEOPLE = (1, 5, 20, 50)
CAMERAS = (1, 2, 4, 6)
DETECTORS = (1, 2, 4)
BUSY = 0.95  # share of a core from which the network limits the rate
RATE_HZ = 15.0
FRAMES, QUICK_FRAMES = 100, 20
LATENCY = ("all but inference p50 [ms]", "p99 [ms]")

Figures = dict[str, float]  # figures of one round, by column
FORMS = {"of the bare network": "{:.2f}", "network busy": "{:.0%}", "processor": "{:.0%}"}


def with_people(count: int, frames: int, bare_hz: float) -> Figures:
    """Return the figures of a number of people before one camera."""
    kind = f"kind={Crowd.__module__}:{Crowd.__name__}"
    model = [f"model={MODEL}", kind, f"max_people={count}"]
    fast = play(lockstep(frames), frames, model)
    paced = play(live(RATE_HZ), frames, model)
    p50, _, p99 = percentiles(paced.others_ms)
    return {
        "frames a second": fast.rate_hz,
        "of the bare network": fast.rate_hz / bare_hz,
        "processor ms a frame": fast.cpu_ms,
        **dict(zip(LATENCY, (p50, p99), strict=True)),
    }


def with_cameras(count: int, frames: int, bare_hz: float) -> Figures:
    """Return the figures of a number of cameras."""
    run = play(live(RATE_HZ), frames * count, [f"model={MODEL}"], cameras=count)
    network_ms = sum(p.ms for path in run.paths for p in path.parts if p.stage == "inference")
    p50, _, p99 = percentiles(run.others_ms)
    age50, _, age99 = percentiles(run.end_to_end_ms)
    return {
        "frames sent a second": count * RATE_HZ,
        "tracked": run.rate_hz,
        "of the bare network": run.rate_hz / bare_hz,
        "network busy": network_ms / len(run.paths) * run.rate_hz / 1e3,
        "processor": run.cpu_ms * run.rate_hz / 1e3,
        **dict(zip(LATENCY, (p50, p99), strict=True)),
        "age p50 [ms]": age50,
        "age p99 [ms]": age99,
    }


def with_detectors(count: int, frames: int, bare_hz: float) -> Figures:
    """Return the figures of a number of detectors on one camera."""
    camera = (*lockstep(frames), f"window={2 * count}")
    run = play(camera, frames, [f"model={MODEL}"], detectors=count)
    return {
        "frames a second": run.rate_hz,
        "of the bare network": run.rate_hz / bare_hz,
        "processor ms a frame": run.cpu_ms,
        "processor": run.cpu_ms * run.rate_hz / 1e3,
    }


def limit(cameras: dict[int, list[Figures]]) -> str:
    """Return a sentence on the number of cameras from which the network is always busy."""
    full = [
        n for n, rounds in cameras.items() if np.median([r["network busy"] for r in rounds]) > BUSY
    ]
    if not full:
        return f"The network is busy for less than {BUSY:.0%} of the time."
    return f"From {min(full)} cameras the network's one thread is always busy and limits the rate."


def table(title: str, found: dict[int, list[Figures]]) -> str:
    """Return the table of figures by a number, of all rounds."""
    columns = list(next(iter(found.values()))[0])
    rows = [
        [
            str(count),
            *(spread([r[name] for r in rounds], FORMS.get(name, "{:.1f}")) for name in columns),
        ]
        for count, rounds in found.items()
    ]
    return markdown([title, *columns], rows)


def main() -> None:
    """Measure both alternately and write the tables."""
    parser = options.parser(__doc__, "rounds", "quick")
    asked = parser.parse_args()
    rounds, frames = (1, QUICK_FRAMES) if asked.quick else (asked.rounds, FRAMES)
    people, cameras, detectors = (defaultdict[int, list[Figures]](list) for _ in range(3))
    for number in range(rounds):
        bare_hz = 1e3 / bare_ms(MODEL)
        for count in PEOPLE:
            print(f"round {number + 1} of {rounds}, {count} people", flush=True)
            people[count].append(with_people(count, frames, bare_hz))
        for count in CAMERAS:
            print(f"round {number + 1} of {rounds}, {count} cameras", flush=True)
            cameras[count].append(with_cameras(count, frames, bare_hz))
        for count in DETECTORS:
            print(f"round {number + 1} of {rounds}, {count} detectors", flush=True)
            detectors[count].append(with_detectors(count, frames, bare_hz))
    write(
        __file__,
        "Load: people, cameras and detectors",
        f"{MODEL}, 640x480, one network thread; {rounds} rounds of {frames} frames, median (least "
        "to most). The bare network is `session.run` of onnxruntime alone in the same round.",
        "## People",
        "One camera. Rate and processor time (all processes) in lock-step, latency at "
        f"{RATE_HZ:.0f} Hz. Copies of the three people of the shipped recording, with depth and "
        "crops where the copies are.",
        table("people", people),
        "## Cameras",
        f"Three people before each, {RATE_HZ:.0f} frames a second from each, one detector, one "
        "tracker; the processor as part of one core. A detector that is too slow takes the newest "
        f"frame of each camera in turn. {limit(cameras)}",
        table("cameras", cameras),
        "## Detectors",
        "Three people before one camera, in lock-step, two frames in flight for each detector; the "
        "processor as part of one core, of two.",
        table("detectors", detectors),
        dry=asked.quick,
    )
