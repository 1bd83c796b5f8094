"""The whole pipeline beside the bare detector: frames per second and latency per stage.

Throughput: lock-step playback, as fast as the pipeline goes, against a loop of `session.run` alone
with the same number of threads; rounds alternate, so that both see the same machine. Latency: at a
rate that the detector can hold (60 % of the bare one), so that queues are empty and the figure is
the cost of the stages themselves.
"""

import argparse
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.lib.system import running
from benchmarks.lib.table import markdown, quantiles, spread, write
from common.inference.onnx import OnnxSession
from common.io.weights import choose, find, folders, load_manifest
from common.runtime.latency import merge_stages, segments
from people4d.messages import Span, Tracks
from services.detector.config import ModelSettings
from services.detector.models.network import ImageInput

SOURCE = "benchmarks.lib.live_camera:StoredDemo"  # a camera that costs nothing
MOVENET_SIZE = (256, 320)
WARM_UP = 10
RATE_SHARE = 0.6


@dataclass(frozen=True)
class Run:
    """Frames of one playback as received by a subscriber.

    Args:
        rate_hz: Frames per second.
        times_ms: Per stage the times of all frames; "whole" is from the frame in hand to its
            people received by the subscriber.
    """

    rate_hz: float
    times_ms: dict[str, list[float]]


def bare_hz(model: str, seconds: float) -> float:
    """Return runs per second of the network alone, single thread.

    Args:
        model: Name in the manifest, or path of an .onnx file.
        seconds: How long to measure.
    """
    path = Path(model)
    if path.suffix != ".onnx":
        path = find(choose(model, load_manifest()), folders(""))
    session = OnnxSession(path, threads=1)
    image = ImageInput.of(session, ModelSettings(), MOVENET_SIZE)
    tensor = image.tensor(np.full((image.height, image.width, 3), 114, np.uint8), 1.0)
    session.run(tensor)
    runs, start = 0, time.perf_counter()
    while time.perf_counter() - start < seconds:
        session.run(tensor)
        runs += 1
    return runs / (time.perf_counter() - start)


def play(model: str, camera: Sequence[str], frames: int) -> Run:
    """Run the pipeline once.

    Args:
        model: Name in the manifest, or path of an .onnx file.
        camera: Settings of the camera that say the pace.
        frames: Frames to play; the recording is looped.
    """
    services = [
        ("tracker", ()),
        ("reid", ()),
        ("detector", (f"model={model}",)),
        ("camera", (f"source={SOURCE}", "loop=true", f"max_frames={frames}", *camera)),
    ]
    times_ms: dict[str, list[float]] = defaultdict(list)
    received: list[float] = []
    with tempfile.TemporaryDirectory() as logs, running(services, Path(logs)) as client:
        for people in client.messages(Tracks, timeout_s=20):
            now_ns = time.time_ns()
            received.append(now_ns / 1e9)
            if len(received) > WARM_UP:
                for stage, duration_ms in stages(people.trace, now_ns):
                    times_ms[stage].append(duration_ms)
            if people.sequence >= frames - 1:
                break
    taken = received[WARM_UP:]
    return Run((len(taken) - 1) / (taken[-1] - taken[0]), dict(times_ms))


def stages(trace: Sequence[Span], now_ns: int) -> list[tuple[str, float]]:
    """Split the way of one frame into its stages and the gaps between them [ms].

    Args:
        trace: Stages passed, oldest first.
        now_ns: When the subscriber had the message.
    """
    split = [(part.name, part.ms) for part in merge_stages(segments(trace))]
    split.append(("to subscriber", (now_ns - trace[-1].end_ns) / 1e6))
    total_ms = (now_ns - trace[0].start_ns) / 1e6
    inference_ms = sum(ms for stage, ms in split if stage == "detector.inference")
    return [*split, ("whole", total_ms), ("whole less inference", total_ms - inference_ms)]


def report(model: str, rounds: int, frames: int) -> list[str]:
    """Measure one model.

    Args:
        model: Name in the manifest, or path of an .onnx file.
        rounds: Pairs of bare and whole runs.
        frames: Frames of one run.

    Returns:
        A heading, a row on throughput and a table of latencies.
    """
    name = Path(model).stem
    bare, end_to_end = [], []
    for number in range(rounds):
        print(f"{name}: round {number + 1} of {rounds}", flush=True)
        bare.append(bare_hz(model, 4.0))
        end_to_end.append(play(model, ("playback=lockstep",), frames).rate_hz)
    ratios = [a / b for a, b in zip(end_to_end, bare, strict=True)]
    speed = RATE_SHARE * float(np.median(bare)) / 15.0  # the recording has 15 frames per second
    print(f"{name}: latency", flush=True)
    paced = play(model, (f"speed={speed}",), frames)
    rows = [[stage, *quantiles(times)] for stage, times in paced.times_ms.items()]
    return [
        f"## {name}",
        markdown(
            ["", "frames per second, median (spread)"],
            [
                ["bare `session.run`, 1 thread", spread(bare, "{:.1f}")],
                ["whole pipeline, lock-step", spread(end_to_end, "{:.1f}")],
                ["ratio, pair by pair", spread(ratios)],
            ],
        ),
        f"Latency at {paced.rate_hz:.1f} frames per second ({RATE_SHARE:.0%} of the bare rate):",
        markdown(["stage", "p50 ms", "p95 ms", "p99 ms"], rows),
    ]


def main() -> None:
    """Measure all models named on the command line."""
    parser = argparse.ArgumentParser(description="Measure the pipeline beside the bare detector.")
    parser.add_argument("models", nargs="*", default=["movenet-multipose"])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--frames", type=int, default=200)
    flags = parser.parse_args()
    sections = [s for m in flags.models for s in report(m, flags.rounds, flags.frames)]
    write(
        __file__,
        "Pipeline: camera, detector, re-ID and tracker as processes, 640x480",
        "The shipped recording (three people) played from memory, one network thread. `whole` is "
        "from the frame being sent by the camera to the people in a subscriber's hands; "
        "docs/operation/latency.md explains the stages. The sum of medians is not the median of "
        "the sum.",
        *sections,
    )


if __name__ == "__main__":
    main()
