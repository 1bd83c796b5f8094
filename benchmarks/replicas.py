"""Detectors beside each other: how much faster two are than one, and what happens when one fails.

Throughput: lock-step playback, as fast as it goes, with one and with two detectors of one thread;
rounds alternate. Beside it the bare network in one and in two processes: more than the machine can
run at once no pipeline reaches. Both must give the same tracks. Failures: playback at a rate that
one detector can hold, while detectors are killed, stopped and added.
"""

import argparse
import itertools
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.lib.system.services import Cluster, Listener, cluster, running
from benchmarks.lib.system.timeline import Event, Frame, draw, lost
from benchmarks.lib.table import markdown, spread, write
from common.inference.onnx import OnnxSession
from common.io.weights import choose, find, folders, load_manifest
from people4d.client import Client
from people4d.codec import encode
from people4d.messages import Tracks
from services.detector.config import ModelSettings
from services.detector.models.network import ImageInput

ROOT = Path(__file__).resolve().parents[1]
SOURCE = "benchmarks.lib.system.live_camera:StoredDemo"  # a camera that costs nothing
YOLO = ROOT.parent / "shared" / "data" / "models" / "yolov8n-pose_640.onnx"
FIGURE = ROOT / "docs" / "pictures" / "replicas.png"
MOVENET_SIZE = (256, 320)
RECORDED_HZ = 15.0
WARM_UP = 10
RATE_SHARE = 0.7  # of what one bare network does
LONG_WAITS = ("embedding_wait_s=60.0", "reorder_wait_s=60.0")  # of the tracker: nothing is skipped
TIMEOUT_S = 120.0  # for the next people message, the first included
WINDOW = 4  # frames unanswered in lock-step: two for each detector
EVERY_S = 6.0  # between two events
CALM_S = 1.5  # without a lost frame after which an event is over
HEADER = ["event", "frames lost", "recovered after", "lost later", "longest latency", "median"]


@dataclass
class Playback:
    """One lock-step run.

    Args:
        rate_hz: Frames per second.
        tracks: The people of every frame as bytes, without their traces.
    """

    rate_hz: float
    tracks: list[bytes] = field(repr=False)


def bare_hz(model: str, processes: int, seconds: float) -> float:
    """Return runs per second of bare networks beside each other, one thread each, all together."""
    # Threads do as processes would: the network runs outside of the interpreter.
    sessions = [OnnxSession(_path(model), threads=1) for _ in range(processes)]
    image = ImageInput.of(sessions[0], ModelSettings(), MOVENET_SIZE)
    tensor = image.tensor(np.full((image.height, image.width, 3), 114, np.uint8), 1.0)

    def runs(session: OnnxSession) -> int:
        count, end_s = 0, time.perf_counter() + seconds
        while time.perf_counter() < end_s:
            session.run(tensor)
            count += 1
        return count

    for session in sessions:
        session.run(tensor)
    with ThreadPoolExecutor(processes) as pool:
        start_s = time.perf_counter()
        total = sum(pool.map(runs, sessions))
        return total / (time.perf_counter() - start_s)


def play(model: str, detectors: int, frames: int) -> Playback:
    """Run the pipeline in lock-step once."""
    camera = (
        *(f"source={SOURCE}", "loop=true", f"max_frames={frames}"),
        *("playback=lockstep", f"window={WINDOW}", f"answer_timeout_s={TIMEOUT_S}"),
    )
    services = [
        ("tracker", LONG_WAITS),
        ("reid", ()),
        *[("detector", (f"model={model}",))] * detectors,
        ("camera", camera),
    ]
    tracks: list[bytes] = []
    times_s: list[float] = []
    with (
        tempfile.TemporaryDirectory() as logs,
        running(services, Path(logs), direct=True) as client,
    ):
        last = -1
        for people in client.messages(Tracks, timeout_s=TIMEOUT_S):
            if people.sequence == last:
                continue  # a prediction, where the machine was slow
            last = people.sequence
            times_s.append(time.monotonic())
            tracks.append(encode(msgspec.structs.replace(people, trace=())))
            if people.sequence >= frames - 1:
                break
    taken_s = times_s[min(WARM_UP, len(times_s) - 2) :]
    return Playback((len(taken_s) - 1) / (taken_s[-1] - taken_s[0]), tracks)


def throughput(model: str, rounds: int, frames: int) -> list[str]:
    """Compare one detector with two."""
    bare: dict[int, list[float]] = {1: [], 2: []}
    end_to_end: dict[int, list[float]] = {1: [], 2: []}
    same = []
    for number in range(rounds):
        print(f"throughput: round {number + 1} of {rounds}", flush=True)
        played = {}
        for count in (1, 2):
            bare[count].append(bare_hz(model, count, 3.0))
            played[count] = play(model, count, frames)
            end_to_end[count].append(played[count].rate_hz)
        same.append(played[1].tracks == played[2].tracks)

    def row(name: str, rates_hz: dict[int, list[float]]) -> list[str]:
        ratios = [two / one for one, two in zip(rates_hz[1], rates_hz[2], strict=True)]
        return [name, *(spread(rates_hz[k], "{:.1f}") for k in (1, 2)), spread(ratios)]

    return [
        "## Throughput",
        markdown(
            ["", "one [frames/s]", "two [frames/s]", "ratio, pair by pair"],
            [row("bare `session.run`, 1 thread each", bare), row("whole pipeline", end_to_end)],
        ),
        f"Tracks with one and with two detectors, byte for byte without their traces: the same in "
        f"{sum(same)} of {rounds} rounds ({frames} frames each).",
    ]


def failures(model: str) -> list[str]:
    """Kill, stop and add detectors while frames come, and count what is lost."""
    rate_hz = RATE_SHARE * bare_hz(model, 1, 3.0)
    camera = (f"source={SOURCE}", "loop=true", f"speed={rate_hz / RECORDED_HZ}")
    print(f"failures: at {rate_hz:.1f} frames per second", flush=True)
    with (
        tempfile.TemporaryDirectory() as logs,
        cluster(Path(logs)) as system,
        Listener(system.endpoint) as client,
    ):
        for service in ("tracker", "reid"):
            system.start(service, f"{service}-1", ())
        for name in ("detector-1", "detector-2"):
            system.start("detector", name, (f"model={model}",))
        system.wait_ready(client, {"tracker-1", "reid-1", "detector-1", "detector-2"})
        system.start("camera", "camera-1", camera)
        frames, events = _watch(client, system, model)
    draw(frames, events, FIGURE)
    rows = [_event_row(event, until, frames) for event, until in _spans(events, frames)]
    return [
        "## Failures",
        f"Two detectors at {rate_hz:.1f} frames per second, {RATE_SHARE:.0%} of what one bare "
        "network does.",
        markdown(HEADER, rows),
        f"Recovered: until the last lost frame was sent, after which none was lost for {CALM_S} s. "
        "What is lost later is not the event's doing, but want of time. Latency is from the frame "
        "being sent to its people in a subscriber's hands.",
        f"![Latency and detector of every frame](../docs/pictures/{FIGURE.name})",
    ]


def _watch(client: Client, system: Cluster, model: str) -> tuple[list[Frame], list[Event]]:
    """Play the events, and note what becomes of every frame."""

    def signal_to(instance: str, number: signal.Signals) -> Callable[[], None]:
        return lambda: system.signal(instance, number)

    plan: Iterator[tuple[str, Callable[[], None]]] = iter(
        [
            ("kill -9 detector-2", signal_to("detector-2", signal.SIGKILL)),
            (
                "start of detector-3",
                lambda: system.start("detector", "detector-3", (f"model={model}",)),
            ),
            ("kill -STOP detector-1", signal_to("detector-1", signal.SIGSTOP)),
            ("kill -CONT detector-1", signal_to("detector-1", signal.SIGCONT)),
            ("SIGTERM to detector-3", signal_to("detector-3", signal.SIGTERM)),
            ("end", lambda: None),
        ]
    )
    frames: list[Frame] = []
    events: list[Event] = []
    next_s = float("inf")
    for people in client.messages(Tracks, timeout_s=TIMEOUT_S):
        now_s = time.time()
        doer = [s.process for s in people.trace if s.process.startswith("detector")]
        if doer and (not frames or people.sequence > frames[-1].sequence):
            sent_s = people.trace[0].end_ns / 1e9
            name = doer[-1].partition("@")[0]
            frames.append(Frame(people.sequence, sent_s, now_s - sent_s, name))
        if frames and next_s == float("inf"):
            next_s = now_s + EVERY_S
        if now_s >= next_s:
            what, act = next(plan)
            act()
            events.append(Event(what, time.time()))
            next_s += EVERY_S
            if what == "end":
                break
    return frames, events


def _spans(events: Sequence[Event], frames: Sequence[Frame]) -> Iterator[tuple[Event, float]]:
    """Yield what happened, and until when it counts; first nothing did."""
    before = [Event("none", frames[0].sent_s), *events]
    for event, following in itertools.pairwise(before):
        yield event, following.at_s


def _event_row(event: Event, until_s: float, frames: Sequence[Frame]) -> list[str]:
    losses_s = [at_s for at_s in lost(frames) if event.at_s <= at_s < until_s]
    count, last_s = 0, event.at_s
    for at_s in losses_s:
        if at_s - last_s > CALM_S:
            break
        count, last_s = count + 1, at_s
    latencies_ms = [f.latency_s * 1e3 for f in frames if event.at_s <= f.sent_s < until_s] or [0.0]
    return [
        event.what,
        str(count),
        f"{last_s - event.at_s:.2f} s" if count else "at once",
        str(len(losses_s) - count),
        f"{max(latencies_ms):.0f} ms",
        f"{np.median(latencies_ms):.0f} ms",
    ]


def _path(model: str) -> Path:
    path = Path(model)
    return path if path.suffix == ".onnx" else find(choose(model, load_manifest()), folders(""))


def main() -> None:
    """Measure throughput and failures."""
    parser = argparse.ArgumentParser(description="Measure detectors beside each other.")
    default = str(YOLO) if YOLO.is_file() else "movenet-multipose"
    parser.add_argument("model", nargs="?", default=default)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--frames", type=int, default=150)
    parser.add_argument("--quick", action="store_true", help="one short round, to try it out")
    flags = parser.parse_args()
    rounds, frames = (1, 40) if flags.quick else (flags.rounds, flags.frames)
    write(
        __file__,
        "Replicas: detectors that share the frames of one camera",
        f"{Path(flags.model).stem}, one thread for each detector, 640x480, the shipped recording "
        "(three people) played from memory. Camera, re-ID and tracker run beside them on the same "
        "cores.",
        *throughput(flags.model, rounds, frames),
        *failures(flags.model),
    )


if __name__ == "__main__":
    main()
