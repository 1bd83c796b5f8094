"""Own work of a frame in one thread: detector, re-ID and tracker joined in memory.

The shipped recording from memory, three people, MoveNet and the shipped embedder. Between: the
networks run in the same thread, which leaves caches as cold as in the pipeline. Stored: their
outputs are those of the first time. Their time is left out.
"""

import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import count, islice
from typing import TypeVar

import numpy as np

from benchmarks.lib import options
from benchmarks.lib.system.live_camera import StoredDemo
from benchmarks.lib.system.playback import INFERENCE
from benchmarks.lib.table import markdown, write
from common.inference.engines import open_session
from common.inference.session import Array, Session
from common.io import weights
from common.runtime.node import Node
from common.transport.trace import ProcessId, collect
from people4d.messages import Crops, Detections, Embeddings, Message, RgbdFrame, Tracks
from services.detector.build import build as build_detector
from services.detector.config import DetectorConfig
from services.detector.models.movenet import MoveNet
from services.reid.build import build as build_reid
from services.reid.config import ReidConfig
from services.tracker.build import build as build_tracker
from services.tracker.config import TrackerConfig

LIMIT_MS = 4.0
FRAMES = 75  # number of frames of the recording
PAUSE_NS = 1_000_000_000  # pause between two rounds of the recording

M = TypeVar("M", bound=Message)


class StoredRuns:
    """A network whose outputs are computed once for each of a number of images in turn."""

    def __init__(self, session: Session, images: int) -> None:
        self.input_shape, self.input_dtype = session.input_shape, session.input_dtype
        self._session, self._images, self._next = session, images, -1  # the first run is a trial
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
        source = StoredDemo(FRAMES)
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
    """Return the one message of a kind.

    Raises:
        ValueError: There is none, or more than one.
    """
    (found,) = (message for message in messages if isinstance(message, kind))
    return found


def quantiles(durations_ms: Sequence[float]) -> list[str]:
    """Return p50, p95 and p99 of durations [ms], as text."""
    return [f"{np.percentile(durations_ms, q):.2f}" for q in (50, 95, 99)]


def main() -> None:
    """Measure both and write the table."""
    parser = options.parser(__doc__)
    parser.add_argument("--rounds", type=int, default=5, help="of the recording")
    flags = parser.parse_args()
    columns: dict[str, dict[str, list[float]]] = {}
    for name, stored in (("networks between", False), ("outputs stored", True)):
        print(name, flush=True)
        frames, found = Chain(stored).run(), columns.setdefault(name, defaultdict(list))
        # Two rounds to warm up and to fill what is stored
        for times_ms in islice(frames, 2 * FRAMES, (2 + flags.rounds) * FRAMES):
            for stage, duration_ms in times_ms.items():
                found[stage].append(duration_ms)
            found["all"].append(sum(times_ms.values()))
    rows = [
        [stage, *(cell for found in columns.values() for cell in quantiles(found[stage]))]
        for stage in next(iter(columns.values()))
    ]
    header = ["stage", *(f"{name}, {q} ms" for name in columns for q in ("p50", "p95", "p99"))]
    write(
        __file__,
        "Own work of a frame, in one thread",
        (__doc__ or "").partition("\n\n")[2].strip(),
        markdown(header, rows),
        f"Wanted: {LIMIT_MS:g} ms in all.",
    )
