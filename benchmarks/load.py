"""Rate, processor time and latency by the number of people and of cameras.

Camera, detector, re-ID and tracker as processes with one network thread. People: copies of
detected people. Cameras: live, 15 frames a second each, on one detector.
"""

from benchmarks.lib import options
from benchmarks.lib.system.crowd import Crowd
from benchmarks.lib.system.playback import bare_hz, live, lockstep, play
from benchmarks.lib.table import markdown, write
from common.runtime.latency import percentiles
from services.detector.config import shipped_model

MODEL = shipped_model()
PEOPLE = (1, 2, 5, 10, 20)
CAMERAS = (1, 2, 4, 6)
RATE_HZ = 15.0


def people_rows(frames: int) -> list[list[str]]:
    """Return a row for each number of people."""
    rows = []
    for count in PEOPLE:
        print(f"{count} people", flush=True)
        kind = f"kind={Crowd.__module__}:{Crowd.__name__}"
        model = [f"model={MODEL}", kind, f"max_people={count}"]
        fast = play(lockstep(frames), frames, model)
        paced = play(live(RATE_HZ), frames, model)
        p50, _, p99 = percentiles(paced.others_ms)
        latency = f"{p50:.1f}, {p99:.1f}"
        rows.append([str(count), f"{fast.rate_hz:.1f}", f"{fast.cpu_ms:.1f}", latency])
    return rows


def camera_rows(frames: int) -> list[list[str]]:
    """Return a row for each number of cameras."""
    rows = []
    for count in CAMERAS:
        print(f"{count} cameras", flush=True)
        run = play(live(RATE_HZ), frames * count, [f"model={MODEL}"], cameras=count)
        network_ms = sum(p.ms for path in run.paths for p in path.parts if p.stage == "inference")
        network_share = network_ms / len(run.paths) * run.rate_hz / 1e3
        p50, _, p99 = percentiles(run.others_ms)
        age50, _, age99 = percentiles(run.end_to_end_ms)
        row = [str(count), f"{count * RATE_HZ:.0f}", f"{run.rate_hz:.1f}"]
        row += [f"{network_share:.0%}", f"{run.cpu_ms * run.rate_hz / 1e3:.0%}"]
        rows.append([*row, f"{p50:.1f}, {p99:.1f}", f"{age50:.1f}, {age99:.1f}"])
    return rows


def main() -> None:
    """Measure both and write the tables."""
    parser = options.parser(__doc__)
    parser.add_argument("--frames", type=int, default=150)
    flags = parser.parse_args()
    bare = bare_hz(MODEL)
    latency = "all but inference p50, p99 [ms]"
    people = ["people", "frames a second", "processor ms a frame", f"{latency} at {RATE_HZ:.0f} Hz"]
    cameras = ["cameras", "frames sent a second", "tracked", "network busy", "processor"]
    write(
        __file__,
        "Load: people and cameras",
        f"{MODEL}, 640x480, one network thread; the network alone runs {bare:.1f} times a second.",
        "## People",
        "One camera. Rate and processor time (all processes) in lock-step. Copies of the three "
        "people of the shipped recording, with depth and crops where the copies are.",
        markdown(people, people_rows(flags.frames)),
        "## Cameras",
        f"Three people before each, {RATE_HZ:.0f} frames a second from each, one detector, one "
        "tracker; the processor as part of one core. A detector that is too slow takes the newest "
        "frame of each camera in turn.",
        markdown([*cameras, latency, "age p50, p99 [ms]"], camera_rows(flags.frames)),
    )
