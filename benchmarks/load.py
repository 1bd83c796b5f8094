"""Rate, processor time and latency by the number of people, and by that of cameras.

Camera, detector, re-ID and tracker as processes with one network thread. People: copies of those
that the network finds. Cameras: live, 15 frames a second each, on one detector.
"""

import argparse
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from benchmarks.latency import INFERENCE, cpu_s, live
from benchmarks.lib.crowd import Crowd
from benchmarks.lib.system import running
from benchmarks.lib.table import markdown, write
from benchmarks.pipeline import bare_hz
from benchmarks.together import WARM_UP, Arrangement, lockstep, others_ms, play
from common.runtime.latency import percentiles
from common.runtime.monitor import FramePath, Monitor
from common.transport.trace import ProcessId
from people4d.messages import Detections, Tracks

MODEL = "movenet-multipose"
PEOPLE = (1, 2, 5, 10, 20)
CAMERAS = (1, 2, 4, 6)
RATE_HZ = 15.0
BARE_S = 4.0
APART = Arrangement(together=False, reserved=False)


@dataclass(frozen=True)
class CamerasRun:
    """One run with several live cameras."""

    rate_hz: float  # tracked frames a second of all cameras together
    cpu_share: float  # of one core, all processes
    inference_share: float  # part of the time in which the network runs
    others_ms: list[float]  # time of each frame in all but inference
    age_ms: list[float]  # time of each frame from the image to the subscriber


def people_rows(frames: int) -> list[list[str]]:
    """Return a row for each number of people."""
    rows = []
    for count in PEOPLE:
        print(f"{count} people", flush=True)
        kind = f"kind={Crowd.__module__}:{Crowd.__name__}"
        model = [f"model={MODEL}", kind, f"max_people={count}"]
        fast = play(APART, model, lockstep(frames), frames)
        paced = play(APART, model, live(RATE_HZ), frames)
        p50, _, p99 = percentiles(paced.others_ms)
        latency = f"{p50:.1f}, {p99:.1f}"
        rows.append([str(count), f"{fast.rate_hz:.1f}", f"{fast.cpu_ms:.1f}", latency])
    return rows


def play_cameras(count: int, frames: int) -> CamerasRun:
    """Run several cameras on one detector.

    Args:
        count: Number of cameras.
        frames: Frames of all cameras to measure, after those for warming up.
    """
    cameras = [("camera", (*live(RATE_HZ), f"camera=c{k}")) for k in range(count)]
    services = [("tracker", ()), ("reid", ()), ("detector", (f"model={MODEL}",)), *cameras]
    monitor = Monitor(ProcessId("subscriber", "subscriber", "here"), 1.0)
    paths, tracked, begin_s, begin_cpu_s = list[FramePath](), 0, 0.0, 0.0
    with tempfile.TemporaryDirectory() as logs, running(services, Path(logs)) as client:
        for arrival in client.arrivals(Tracks, Detections, timeout_s=30):
            path = monitor.add(arrival, time.time_ns(), time.monotonic())
            if path is None:
                continue
            tracked += 1
            if tracked == WARM_UP * count:
                begin_s, begin_cpu_s = time.perf_counter(), cpu_s()
            if tracked > WARM_UP * count:
                paths.append(path)
            if len(paths) == frames:
                break
        seconds, used_s = time.perf_counter() - begin_s, cpu_s() - begin_cpu_s
    inference_ms = sum(p.ms for path in paths for p in path.parts if p.stage in INFERENCE[:1])
    return CamerasRun(
        rate_hz=frames / seconds,
        cpu_share=used_s / seconds,
        inference_share=inference_ms / 1e3 / seconds,
        others_ms=[others_ms(path) for path in paths],
        age_ms=[path.end_to_end.ms for path in paths],
    )


def camera_rows(frames: int) -> list[list[str]]:
    """Return a row for each number of cameras."""
    rows = []
    for count in CAMERAS:
        print(f"{count} cameras", flush=True)
        run = play_cameras(count, frames * count)
        (p50, _, p99), (age50, _, age99) = percentiles(run.others_ms), percentiles(run.age_ms)
        row = [str(count), f"{count * RATE_HZ:.0f}", f"{run.rate_hz:.1f}"]
        row += [f"{run.inference_share:.0%}", f"{run.cpu_share:.0%}"]
        rows.append([*row, f"{p50:.1f}, {p99:.1f}", f"{age50:.1f}, {age99:.1f}"])
    return rows


def main() -> None:
    """Measure both and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=150)
    flags = parser.parse_args()
    bare = bare_hz(MODEL, BARE_S)
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
        "frame of each camera in turn. With several cameras the tracker waits up to one period of "
        "the frames for earlier ones of another camera.",
        markdown([*cameras, latency, "age p50, p99 [ms]"], camera_rows(flags.frames)),
    )


if __name__ == "__main__":
    main()
