"""Own work of a frame in one thread: detector, re-ID and tracker joined in memory.

The input is the shipped recording from memory with three people, MoveNet and the shipped embedder.
"Between": the networks run in the same thread, which leaves caches as cold as in the pipeline.
"Stored": the outputs of the first run are reused. The networks' time is left out.
"""

import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import count, islice
from typing import TypeVar

import numpy as np

from benchmarks.lib import options
from benchmarks.lib.system.bare import FLOAT, INFERENCE, bare_ms
from benchmarks.lib.system.live_camera import StoredDemo, frames_file
from benchmarks.lib.system.tracker_cost import tracker_table
from benchmarks.lib.table import markdown, spread, write
from common.inference.engines import open_session
from common.inference.session import Array, Session
from common.io import weights
from common.runtime.node import Node
from common.transport.trace import ProcessId, collect
from people4d.messages import F64, Crops, Detections, Embeddings, Message, RgbdFrame, Tracks
from services.detector.build import build as build_detector
from services.detector.config import DetectorConfig
from services.detector.models.movenet import MoveNet
from services.reid.build import build as build_reid
from services.reid.config import ReidConfig
from services.tracker.build import build as build_tracker
from services.tracker.config import TrackerConfig

SHARE_MAX = 0.20  # Wanted share of the time of the float network
FRAMES = 75  # number of frames of the recording
PAUSE_NS = 1_000_000_000  # pause between two rounds of the recording

M = TypeVar("M", bound=Message)


class StoredRuns:
    """A network whose outputs are computed once for each of a number of images in turn."""

    def __init__(self, session: Session, images: int) -> None:
        self.input_shape, self.input_dtype = session.input_shape, session.input_dtype
        self._session, self._images, self._next = session, images, -1  # the first run is a check
        self._outputs: list[Mapping[str, Array]] = []

    def run(self, image: Array) -> Mapping[str, Array]:
        """Return the outputs for the next image."""
        number, self._next = self._next, self._next + 1
        if number < 0:
            return self._session.run(image)
        if len(self._outputs) < self._images:
            self._outputs.append(self._session.run(image))
        return self._outputs[number % self._images]


class Chain:
    """Nodes joined in memory, with the times of a frame in each stage.

    Args:
        stored: Whether the detector's network runs but once for each image.
    """

    def __init__(self, stored: bool) -> None:
        source = StoredDemo(frames_file(FRAMES))
        self._frames, info = list(source), source.info
        path, _ = weights.locate(DetectorConfig().model, "")
        session: Session = open_session(path)
        if stored:
            session = StoredRuns(session, FRAMES)
        config = DetectorConfig()
        self._nodes: dict[str, Node] = {
            "detector": build_detector(config, MoveNet(session, config)),
            "reid": build_reid(ReidConfig()),
            "tracker": build_tracker(TrackerConfig()),
        }
        for message in (info, *source.transforms):
            for node in self._nodes.values():
                if isinstance(message, node.inputs):
                    node.handle(message, 0)
        self._camera = info.camera

    def run(self) -> Iterator[dict[str, float]]:
        """Yield the times of all stages except inference [ms], frame by frame, endlessly."""
        stamps_ns = [frame.stamp_ns for frame in self._frames]
        length_ns = stamps_ns[-1] - stamps_ns[0] + PAUSE_NS
        for number in count():
            turn, index = divmod(number, FRAMES)
            frame = self._frames[index]
            yield self._frame(
                RgbdFrame(
                    stamp_ns=frame.stamp_ns + turn * length_ns,
                    sequence=number,
                    camera=self._camera,
                    rgb=frame.rgb,
                    depth_mm=frame.depth_mm,
                )
            )

    def _frame(self, frame: RgbdFrame) -> dict[str, float]:
        times_ms: dict[str, float] = defaultdict(float)
        answers = self._handle("detector", frame, times_ms)
        embeddings = only(Embeddings, self._handle("reid", only(Crops, answers), times_ms))
        tracked = self._handle("tracker", only(Detections, answers), times_ms)
        tracked += self._handle("tracker", embeddings, times_ms)
        only(Tracks, tracked)
        return times_ms

    def _handle(self, name: str, message: Message, times_ms: dict[str, float]) -> list[Message]:
        begin_ns = time.perf_counter_ns()
        with collect(ProcessId(name, name, "here")) as spans:
            answers = list(self._nodes[name].handle(message, message.stamp_ns))
        left_ms = (time.perf_counter_ns() - begin_ns) / 1e6
        for one in spans:
            stage, duration_ms = one.stage.partition(".")[2], (one.end_ns - one.start_ns) / 1e6
            left_ms -= duration_ms
            if stage not in INFERENCE:
                times_ms[one.stage] += duration_ms
        times_ms[f"{name}.other"] += left_ms
        return answers


def only(kind: type[M], messages: Iterable[Message]) -> M:
    """Return the one message of a kind; ValueError if there is none, or more than one."""
    (found,) = (message for message in messages if isinstance(message, kind))
    return found


def main() -> None:
    """Measure both kinds of run alternately and write the table."""
    parser = options.parser(__doc__, "rounds", "quick")
    asked = parser.parse_args()
    rounds = 1 if asked.quick else asked.rounds
    chains = {"networks between": Chain(False).run(), "outputs stored": Chain(True).run()}
    found: dict[str, dict[str, list[F64]]] = {}
    bare = list[float]()
    for frames in chains.values():  # warm up, and fill the stored outputs
        next(islice(frames, 2 * FRAMES, None))
    for number in range(rounds):
        print(f"round {number + 1} of {rounds}", flush=True)
        bare.append(bare_ms(FLOAT))
        for name, frames in chains.items():
            times_ms = list(islice(frames, FRAMES))
            found.setdefault("all", {}).setdefault(name, []).append(
                np.array([sum(one.values()) for one in times_ms])
            )
            for stage in times_ms[0]:
                found.setdefault(stage, {}).setdefault(name, []).append(
                    np.array([one[stage] for one in times_ms])
                )
    share = [
        float(np.median(ms)) / run_ms
        for ms, run_ms in zip(found["all"]["networks between"], bare, strict=True)
    ]
    found["all"] = found.pop("all")  # moved to the last row
    rows = [
        [stage, *(cell for name in chains for cell in quantiles(columns[name]))]
        for stage, columns in found.items()
    ]
    header = ["stage", *(f"{name}, {q} ms" for name in chains for q in ("p50", "p99"))]
    write(
        __file__,
        "Own work of a frame, in one thread",
        (__doc__ or "").partition("\n\n")[2].strip(),
        f"{rounds} rounds of {FRAMES} frames in turns, median (least to most).",
        markdown(header, rows),
        markdown(
            ("own work, networks between", "median (least to most)", "wanted"),
            [["part of a run of the float network", spread(share), f"at most {SHARE_MAX:.2f}"]],
        ),
        "## Tracker's node by number of people",
        tracker_table(rounds, asked.quick),
        dry=asked.quick,
    )


def quantiles(rounds_ms: Sequence[F64]) -> list[str]:
    """Return p50 and p99 of each round [ms], as text."""
    return [spread([float(np.percentile(ms, q)) for ms in rounds_ms]) for q in (50, 99)]
