"""The whole pipeline for a long time: does anything grow?

At a steady rate, or (`--overload`) at twice the sustainable rate, which is measured first, in
lock-step: the newest frame wins, so that every second frame is dropped and latency must stay what
it is. Memory, file descriptors and shared memory are sampled every few seconds.
"""

import argparse
import itertools
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.lib.system.growth import Observer, ProcessSamples, after_warm_up, slope
from benchmarks.lib.system.services import Cluster, Listener, cluster
from benchmarks.lib.table import markdown, quantiles, write
from benchmarks.replicas import RECORDED_HZ, SOURCE, TIMEOUT_S, play
from people4d.client import Client
from people4d.messages import Health, Tracks

OVERLOAD = 2.0
FRAMES = 200  # to find the sustainable rate
WARM_UP_SHARE = 0.2  # of the time, left out of the fit
SAMPLES = 720  # in the whole time, at most one a second
PARTS = 4  # of the time, whose latencies are compared
LOSSES = ("dropped_", "gaps_", "stale", "duplicates", "missing", "embedding_timeouts", "errors")


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


def soak(model: str, detectors: int, minutes: float, rate_hz: float) -> Soak:
    """Send frames at a rate for a time."""
    with (
        tempfile.TemporaryDirectory() as logs,
        cluster(Path(logs)) as system,
        Listener(system.endpoint) as client,
    ):
        names = ["tracker-1", "reid-1", "predictor-1"]
        names += [f"detector-{k + 1}" for k in range(detectors)]
        for name in names:
            service = name.partition("-")[0]
            system.start(service, name, (f"model={model}",) if service == "detector" else ())
        system.wait_ready(client, set(names))
        camera = (f"source={SOURCE}", "loop=true", f"speed={rate_hz / RECORDED_HZ}")
        system.start("camera", "camera-1", camera)
        return _observed(system, client, minutes * 60, rate_hz)


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


def report(run: Soak) -> list[str]:
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
    shared = after_warm_up(run.observer.shared_mb, WARM_UP_SHARE)
    losses = [
        [name, cause, str(count)]
        for name, health in sorted(run.healths.items())
        for cause, count in sorted(health.counters.items())
        if count and cause.startswith(LOSSES)
    ]
    return [
        f"Wanted of the camera: {run.rate_hz:.1f} frames per second, sent: {sent_hz:.1f}; people "
        f"came for {done_hz:.1f} a second.",
        "## Latency",
        "From the frame being sent to its people in a subscriber's hands.",
        markdown(["minutes", "frames", "p50 ms", "p95 ms", "p99 ms", "longest ms"], latency_rows),
        "## Growth",
        markdown(["process", "memory [MB]", "slope [MB/h] (95 %)", "file descriptors"], rows),
        f"Files in /dev/shm that these processes held: {shared[0]:.1f} MB after the warm-up, "
        f"{shared[-1]:.1f} MB at the end (least {min(shared):.1f}, most {max(shared):.1f}).",
        "## What was dropped, by cause",
        markdown(["process", "cause", "count"], losses),
    ]


def _grown(name: str, samples: ProcessSamples) -> list[str]:
    times_s = after_warm_up(samples.times_s, WARM_UP_SHARE)
    memory_mb = after_warm_up(samples.memory_mb, WARM_UP_SHARE)
    rise, low, high = slope(times_s, memory_mb)
    descriptors = after_warm_up(samples.descriptors, WARM_UP_SHARE)
    return [
        name,
        f"{np.median(memory_mb):.1f} ({min(memory_mb):.1f} to {max(memory_mb):.1f})",
        f"{rise:+.2f} ({low:+.2f} to {high:+.2f})",
        f"{descriptors[0]} to {descriptors[-1]} (most {max(descriptors)})",
    ]


def main() -> None:
    """Run as long as the command line says."""
    parser = argparse.ArgumentParser(description="Run the pipeline for a long time.")
    parser.add_argument("model", nargs="?", default="movenet-multipose")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--detectors", type=int, default=2)
    parser.add_argument("--rate", type=float, default=10.0, help="frames a second")
    parser.add_argument(
        "--overload", action="store_true", help="twice the sustainable rate; no file is written"
    )
    flags = parser.parse_args()
    rate_hz = flags.rate
    if flags.overload:
        rate_hz = OVERLOAD * play(flags.model, flags.detectors, FRAMES).rate_hz
    parts = report(soak(flags.model, flags.detectors, flags.minutes, rate_hz))
    if flags.overload:
        print(*parts, sep="\n\n")
        return
    write(
        __file__,
        f"Soak: {flags.minutes:g} minutes at {rate_hz:g} frames a second",
        f"{Path(flags.model).stem}, {flags.detectors} detectors of one thread, 640x480, the "
        "shipped recording in a loop, from memory. Memory is what the process has written itself: "
        f"median, least and most after the first {WARM_UP_SHARE:.0%} of the time. Its slope is "
        "that of Theil and Sen over medians of a minute; the interval comes from a moving-block "
        "bootstrap.",
        *parts,
    )


if __name__ == "__main__":
    main()
