"""Skeletons of people in the virtual lab against their true joints.

Frames are drawn as a camera would take them and pass detector, re-identification, tracker and
skeletons with the shipped settings. A joint is visible if the camera sees the body there; hidden
joints are those behind other people, behind the person's own body, or outside of the image.
"""

import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from benchmarks.lib.table import markdown, write
from common.runtime.node import Node
from common.transport.memory_bus import MemoryBus
from evaluation.pipeline import pipeline
from evaluation.recordings.rendered import rgbd_frame
from lab.camera.frames import FrameRenderer, RenderSettings, transforms
from lab.catalogue import load_scenario
from lab.truth.frames import PersonView, person_views
from lab.world import World
from people4d.messages import F64, JOINTS, Message, Skeletons, Tracks
from services.detector.config import DetectorConfig
from services.skeleton.build import build
from services.skeleton.config import SkeletonConfig

# Scenario, seed and frames.
CHOSEN_ON = (
    ("two_crossing", 31, range(0, 240, 3)),
    ("three_dense", 33, range(300, 480, 3)),
    ("gait_three", 32, range(0, 240, 3)),
    ("short_sit", 34, range(0, 240, 4)),
)
HELD_OUT = (
    ("two_crossing", 802, range(300, 540, 2)),
    ("three_crossing", 803, range(300, 540, 2)),
    ("four_crossing", 804, range(300, 540, 2)),
    ("gait_turn", 805, range(0, 240, 2)),
    ("gait_three", 806, range(0, 240, 2)),
    ("short_sit", 807, range(0, 240, 3)),
)
NEAR_M = 0.5  # a track is a person's who is nearest, and so near
ELLIPSOID = 6.251  # 90 % quantile of chi squared with three degrees of freedom
PARTS = {
    "head": (0, 1, 2, 3, 4),
    "shoulders": (5, 6),
    "elbows": (7, 8),
    "wrists": (9, 10),
    "hips": (11, 12),
    "knees": (13, 14),
    "ankles": (15, 16),
}
HEADER = ["", "visible m", "p90", "hidden m", "p90"]
HEADER += ["visible measured %", "hidden predicted %", "in ellipsoids: measured %", "predicted %"]


@dataclass(frozen=True)
class JointErrors:
    """Errors of people's joints; each array has N rows of 17."""

    distance_m: F64
    normalised: F64  # squared, by the covariance
    visible: F64  # 1: the camera sees it
    measured: F64  # 1: published as measured

    @classmethod
    def joined(cls, parts: "Sequence[JointErrors]") -> "JointErrors":
        """Return the errors of all parts."""
        names = ("distance_m", "normalised", "visible", "measured")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


class TimedNode(Node):
    """A node that notes the processor time of messages that it answers."""

    def __init__(self, node: Node) -> None:
        self._node, self.inputs = node, node.inputs
        self.times_ms: list[float] = []

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Pass a message on."""
        start_s = time.process_time()
        found = self._node.handle(message, now_ns)
        if isinstance(message, Tracks):
            self.times_ms.append((time.process_time() - start_s) * 1e3)
        return found


def skeletons_of(
    name: str, seed: int, indices: range, times_ms: list[float]
) -> Iterator[tuple[Skeletons, Sequence[PersonView]]]:
    """Yield the skeletons and the truth of every frame that has skeletons."""
    world = World(load_scenario(name), seed)
    renderer = FrameRenderer(world, RenderSettings())
    timed = TimedNode(build(SkeletonConfig()))
    bus = MemoryBus([*pipeline(DetectorConfig()), timed])
    bus.publish(world.info, *transforms(world))
    for index in indices:
        view = renderer.view(index)
        for message in bus.publish(rgbd_frame(renderer, index, view)):
            if isinstance(message, Skeletons):
                yield message, person_views(world, world.frame_s(index), view)
        bus.log.clear()
    times_ms += timed.times_ms


def errors_of(name: str, seed: int, indices: range, times_ms: list[float]) -> JointErrors:
    """Return the errors of all joints of people who are tracked."""
    rows = []
    for found, people in skeletons_of(name, seed, indices, times_ms):
        for skeleton in found.people:
            middle_m = skeleton.positions_m[[5, 6, 11, 12]].mean(axis=0)
            away_m = [float(np.linalg.norm(person.position_m - middle_m)) for person in people]
            nearest = int(np.argmin(away_m))
            if away_m[nearest] > NEAR_M:
                continue
            gap_m = skeleton.positions_m.astype(np.float64) - people[nearest].keypoints_m
            inverse = np.linalg.inv(skeleton.covariances_m2.astype(np.float64))
            rows.append(
                (
                    np.linalg.norm(gap_m, axis=1),
                    np.einsum("ji,jik,jk->j", gap_m, inverse, gap_m),
                    people[nearest].visible.astype(np.float64),
                    np.array(skeleton.measured, np.float64),
                )
            )
    return JointErrors(*(np.array(column) for column in zip(*rows, strict=True)))


def row(name: str, errors: JointErrors, joints: Sequence[int]) -> list[str]:
    """Return the cells of some joints."""
    distance_m, inside = errors.distance_m[:, joints], errors.normalised[:, joints] <= ELLIPSOID
    visible, measured = errors.visible[:, joints] == 1, errors.measured[:, joints] == 1
    cells = [name]
    for some in (visible, ~visible):
        empty = not some.any()
        quantiles = (50, 90)
        cells += ["" if empty else f"{np.percentile(distance_m[some], q):.3f}" for q in quantiles]
    for part, base in ((measured, visible), (~measured, ~visible), (inside, measured)):
        cells.append(f"{100 * part[base].mean():.0f}" if base.any() else "")
    cells.append(f"{100 * inside[~measured].mean():.0f}" if (~measured).any() else "")
    return cells


def main() -> None:
    """Measure both halves, and write the tables."""
    parts: list[str] = []
    times_ms: list[float] = []
    for title, sequences in (("Held out", HELD_OUT), ("Constants chosen on", CHOSEN_ON)):
        found = {f"{n}@{seed}": errors_of(n, seed, i, times_ms) for n, seed, i in sequences}
        together = JointErrors.joined(list(found.values()))
        rows = [row("all", together, range(len(JOINTS)))]
        rows += [row(name, together, joints) for name, joints in PARTS.items()]
        rows += [row(name, errors, range(len(JOINTS))) for name, errors in found.items()]
        parts += [f"## {title}", markdown(HEADER, rows)]
    text = (
        "Median distance of joints from the true ones, and that which 90 % stay below; how many of "
        "the visible joints are published as measured and of the hidden ones as predicted; how "
        "often the truth is inside the 90 % ellipsoid. Lost people count."
    )
    cost = f"Processor time of the service for one frame: median {np.median(times_ms):.1f} ms."
    write(__file__, "Skeletons", text, *parts, cost)


if __name__ == "__main__":
    main()
