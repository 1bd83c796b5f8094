"""Cost of a frame in each node, by counts that are independent of the machine's noise.

Each node gets what it got in a run over the shipped recording. Cost is counted in calls of Python
functions, calls of compiled functions of NumPy and OpenCV, executed lines of this project, and
allocated bytes; on the bus in messages and bytes. Budgets are written by
`python -m tests.pipeline.frame_cost`.

A profile shows calls of compiled functions and methods only. Not counted are NumPy's universal
functions (`np.add`, `np.sqrt`), operators, indexing, and functions that NumPy dispatches
(`np.where`, `np.concatenate`); their lines and allocations are.
"""

import json
import sys
import tracemalloc
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from types import FrameType
from typing import Any

import cv2

from common.runtime.node import Node
from evaluation.pipeline import pipeline, play
from people4d.codec import decode, encode
from people4d.messages import Message, TargetCommand
from services.camera.config import CameraConfig
from services.detector.config import DetectorConfig, OrientationConfig
from services.events.build import build as build_events
from services.events.config import EventsConfig
from services.gait.build import build as build_gait
from services.gait.config import GaitConfig
from services.predictor.build import build as build_predictor
from services.predictor.config import PredictorConfig
from services.skeleton.build import build as build_skeleton
from services.skeleton.config import SkeletonConfig
from services.target.build import build as build_target
from services.target.config import TargetConfig
from tests import DEMO, ROOT

BUDGETS = Path(__file__).with_name("budgets.json")
WARM, COUNTED = 20, 10  # number of warm-up frames, and of counted frames
FOLLOWED = 10  # warm-up frame after which the nearest person is followed
TOLERANCE = 0.03  # share of a budget
SHOWN = 5  # files that are named
# Networks in float: of the same output on every processor
NETWORKS = DetectorConfig(
    model="movenet-multipose", orientation=OrientationConfig(network="orientation-lab")
)
KINDS = ("calls", "array_calls", "lines")
FOLDERS = ("people4d", "common", "services")
# Functions of OpenCV have no module, and are known by their identity
OPENCV = {
    id(member)
    for module in (cv2, cv2.aruco, cv2.fisheye)
    for member in vars(module).values()
    if callable(member)
}
OWN = tuple(str(ROOT / folder) for folder in FOLDERS)

Costs = dict[str, dict[str, float]]  # cost of one frame by kind and file


class Counting:
    """Counts calls and lines of this thread by kind and file while the context is entered."""

    def __init__(self) -> None:
        self.counts: dict[str, Counter[str]] = {kind: Counter() for kind in KINDS}

    def __enter__(self) -> "Counting":
        sys.settrace(self._trace)
        sys.setprofile(self._profile)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)
        sys.settrace(None)

    def _profile(self, frame: FrameType, event: str, function: Any) -> None:
        if event == "call" and frame.f_code.co_filename != __file__:
            self.counts["calls"][file_of(frame)] += 1
        elif event == "c_call" and is_of_arrays(function):
            self.counts["array_calls"][file_of(frame)] += 1

    def _trace(self, frame: FrameType, event: str, _: object) -> Any:
        if not frame.f_code.co_filename.startswith(OWN):
            return None
        if event == "line":
            self.counts["lines"][file_of(frame)] += 1
        return self._trace


class Allocations:
    """Counts bytes by file: what each line allocates at once, while the context is entered."""

    def __init__(self) -> None:
        self.kilobytes: defaultdict[str, float] = defaultdict(float)
        self._file, self._base = "elsewhere", 0  # file of the line, and bytes before it

    def __enter__(self) -> "Allocations":
        tracemalloc.start()
        self._begin("elsewhere")
        sys.settrace(self._trace)
        return self

    def __exit__(self, *_: object) -> None:
        sys.settrace(None)
        self._end(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()

    def _trace(self, frame: FrameType, event: str, _: object) -> Any:
        peak = tracemalloc.get_traced_memory()[1]  # first, since naming the file allocates
        if not frame.f_code.co_filename.startswith(OWN):
            return None
        self._end(peak)
        self._begin(file_of(frame.f_back if event == "return" and frame.f_back else frame))
        return self._trace

    def _end(self, peak: int) -> None:
        self.kilobytes[self._file] += (peak - self._base) / 1000

    def _begin(self, file: str) -> None:
        self._file = file
        tracemalloc.reset_peak()
        self._base = tracemalloc.get_traced_memory()[0]


def file_of(frame: FrameType) -> str:
    """Return the file of this project that a call belongs to: its own or the nearest caller's."""
    at: FrameType | None = frame
    while at is not None and not at.f_code.co_filename.startswith(OWN):
        at = at.f_back
    return relative(at.f_code.co_filename) if at else "elsewhere"


@cache
def relative(file: str) -> str:
    """Return the path of a file of this project."""
    return str(Path(file).relative_to(ROOT))


def is_of_arrays(function: Any) -> bool:
    """Check whether a compiled function or method belongs to NumPy or OpenCV."""
    if id(function) in OPENCV:
        return True
    module = getattr(function, "__module__", None) or type(function.__self__).__module__
    return str(module).partition(".")[0] in {"numpy", "cv2"}


def cost(steps: Sequence[Sequence[Message]], handle: Callable[[Message], object]) -> Costs:
    """Return the cost of a frame whose inputs are handled one after another."""
    counting, allocations = Counting(), Allocations()
    for number, step in enumerate(steps):
        if number < WARM:
            run(step, handle)
        elif number < WARM + COUNTED:
            with counting:
                run(step, handle)
        else:  # memory is measured in separate frames, since counting allocates
            with allocations:
                run(step, handle)
    kinds: dict[str, Mapping[str, float]] = {
        **counting.counts,
        "kilobytes": allocations.kilobytes,
    }
    return {
        kind: {file: round(count / COUNTED, 2) for file, count in sorted(counts.items())}
        for kind, counts in kinds.items()
    }


def run(step: Sequence[Message], handle: Callable[[Message], object]) -> None:
    """Handle the inputs of a frame."""
    for message in step:
        handle(message)


def make_nodes() -> dict[str, Node]:
    """Build the nodes whose cost is counted."""
    detector, reid, tracker = pipeline(NETWORKS)
    return {
        "detector": detector,
        "reid": reid,
        "tracker": tracker,
        "predictor": build_predictor(PredictorConfig()),
        "skeleton": build_skeleton(SkeletonConfig()),
        "gait": build_gait(GaitConfig()),
        "target": build_target(TargetConfig()),
        "events": build_events(EventsConfig()),
    }


def measure() -> dict[str, Costs]:
    """Return the cost of a frame in each node, in the codec, and on the bus."""
    frames = WARM + 2 * COUNTED
    camera = CameraConfig(
        source=str(DEMO), playback="lockstep", start_delay_s=0.0, max_frames=frames
    )
    steps = [step.messages for step in play(camera, list(make_nodes().values()))]
    follow = TargetCommand(stamp_ns=1, sequence=0, action="nearest")
    steps[FOLLOWED] = [*steps[FOLLOWED], follow]
    costs = {}
    for name, node in make_nodes().items():
        inputs = [[one for one in step if isinstance(one, node.inputs)] for step in steps]
        costs[name] = cost(inputs, partial(node.handle, now_ns=0))
    costs["codec"] = cost(steps, lambda message: decode(encode(message)))
    return costs | {"bus": bus(steps[WARM : WARM + COUNTED])}


def bus(steps: Sequence[Sequence[Message]]) -> Costs:
    """Return messages and bytes of a frame by type of message."""
    messages, size = Counter[str](), Counter[str]()
    for message in (message for step in steps for message in step):
        messages[type(message).__name__] += 1
        size[type(message).__name__] += len(encode(message))
    counts = {"messages": messages, "bytes": size}
    return {
        kind: {name: count / len(steps) for name, count in sorted(of.items())}
        for kind, of in counts.items()
    }


def excess(costs: Mapping[str, Costs], budgets: Mapping[str, Costs]) -> Iterator[str]:
    """Yield the costs over budget, with the files that grew most."""
    for name, of_name in costs.items():
        for kind, now in of_name.items():
            before = budgets[name][kind]
            total, budget = sum(now.values()), sum(before.values())
            if total > (1 + TOLERANCE) * budget:
                growth = {at: count - before.get(at, 0.0) for at, count in now.items()}
                most = sorted(growth, key=lambda at: -growth[at])[:SHOWN]
                listing = ", ".join(f"{at} +{growth[at]:.4g}" for at in most if growth[at] > 0)
                yield f"{name}: {total:.6g} {kind} a frame, budget {budget:.6g}: {listing}"


def write_budgets() -> None:
    """Write the current costs as the budgets."""
    lines = [
        f'  "{node}": {{\n'
        + ",\n".join(f'    "{kind}": {json.dumps(of)}' for kind, of in costs.items())
        + "\n  }"
        for node, costs in measure().items()
    ]
    BUDGETS.write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    write_budgets()
