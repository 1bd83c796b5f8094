"""Steps and points of real people against annotated landings and the depth of their bodies.

The recordings show identifiable people and are not part of the repository: `--shared` names the
folder that holds them. Annotated landings are in `real_people_marks/filinha_steps.json`.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from benchmarks.gait_bodies import NO_KEYPOINTS
from benchmarks.lib import options
from benchmarks.lib.gait.causes import STAGES, Scene, first_loss
from benchmarks.lib.marks.crossing import MOUNT_RPY_RAD, MOUNT_XYZ_M, TORSO_MM, Pixel
from benchmarks.lib.table import markdown, write
from common.geometry.transforms import apply, invert, project
from evaluation.annotations.marks import Mark, read_frames
from evaluation.gait.report import read_run
from evaluation.gait.run import BoxCorners, estimate_gait
from evaluation.gait.tables import GaitTables
from people4d.messages import F64, CameraInfo
from services.gait.estimator import GaitFrame, GaitResult

MARKS = Path(__file__).with_name("real_people_marks")
# Rates of playback [Hz] and settings: plausible for walking, and as in other benchmarks
PLAYED: Mapping[str, tuple[float, tuple[str, ...]]] = {
    "4 Hz": (4.0, ()),
    "10 Hz": (10.0, ()),
    "4 Hz, without keypoints": (4.0, (NO_KEYPOINTS,)),
}
WALKING_HZ = 4.0  # Rate at which the pictures show people walking
NEAR_FRAMES = 1.2  # Maximum time between an annotated and a published step [frames]
OWNER_FRAMES = 5  # Number of frames about a step that assign it to a person
TORSO_HALF_PX, TORSO_TOP_PX = 90.0, 40.0  # Half width and top of the box in a TUE bag [px]
AROUND_PX, SAME_M = 4, 0.10  # Maximum distance of a point from its depth reading [px, m]
LIMBS = ("left_hand", "right_hand", "left_foot", "right_foot")
INTRO = """
Real people walk before a fixed Xtion (filinha, 108 pictures: they enter, turn and leave, behind
desks and each other) and stand before a robot (TUE, five single pictures).

- Landings were counted by eye in all pictures (`real_people_marks/filinha_steps.json`), in the
  frames in which the feet can be followed. A published step finds one of the same person within
  1.2 frames; without one it is invented.
- Constants were chosen on N, G and S alone.
- The pictures have no times. At 4 Hz people take 104 to 120 steps a minute at 0.8 to 1.1 m/s; at
  10 Hz, as other benchmarks play them, it would be 300 at more than 2 m/s.
- On the depth: measured points with a depth within 0.10 m of their own, no farther than 4 px
  away.
"""
CAUSES = """
Steps that are lost, by the first stage that fails in the landing's frame and its neighbours:
"""
Run = list[tuple[CameraInfo, GaitFrame, Sequence[GaitResult]]]


class StepByEye(msgspec.Struct, frozen=True):
    """Landing of a foot."""

    frame: float
    foot: Literal["left", "right"]
    hidden: bool = False  # True: the foot was not visible at the landing


class StepsByEye(msgspec.Struct, frozen=True):
    """Landings of one person, and the frames in which they can be counted."""

    person: str
    half: Literal["choose", "judge"]
    spans: tuple[tuple[float, float], ...]
    steps: tuple[StepByEye, ...]


class _StepFile(msgspec.Struct, frozen=True):
    people: tuple[StepsByEye, ...]


@dataclass
class StepCounts:
    """Steps of one person, or of several."""

    true: int = 0
    hidden: int = 0  # number of true steps of an invisible foot
    published: int = 0  # number of steps in the frames with counted steps
    found: int = 0
    other_foot: int = 0  # number of found steps of the wrong foot
    invented: int = 0
    off_frames: list[float] = field(default_factory=list)
    lost: list[StepByEye] = field(default_factory=list)  # true steps without a published one

    def add(self, other: "StepCounts") -> None:
        """Add the steps of another person."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)

    def cells(self) -> list[str]:
        """Return the figures of a row."""
        off = f"{np.median(self.off_frames):.1f}" if self.off_frames else "-"
        numbers = (self.true, self.hidden, self.published)
        rest = (self.other_foot, self.invented)
        return [*map(str, numbers), f"{self.found} of {self.true}", *map(str, rest), off]


def play(source: Path, settings: Iterable[str], box: BoxCorners | None = None) -> Run:
    """Return the results of all frames of a source, for all people or for the one in a box."""
    found: Run = []
    run = read_run(str(source), box, "", tuple(settings))
    for _ in estimate_gait(run, lambda *frame: found.append(frame)):
        pass
    return found


def owners(run: Run, marks: dict[int, tuple[Mark, ...]]) -> dict[tuple[int, int], str]:
    """Return the person of each track and frame: the mark nearest to the middle of its box."""
    found = {}
    for index, (_, _, results) in enumerate(run):
        for one in results:
            box = one.person.box_xyxy_px
            if box is None:
                continue
            left, top, right, bottom = map(float, box)
            inside = [
                (abs(2 * m.u_px - left - right) + abs(2 * m.v_px - top - bottom), m.person)
                for m in marks.get(index, ())
                if left <= m.u_px <= right and top <= m.v_px <= bottom
            ]
            if inside:
                found[one.person.id, index] = min(inside)[1]
    return found


def published_steps(
    run: Run, owner: Mapping[tuple[int, int], str], rate_hz: float
) -> dict[str, list[tuple[float, str]]]:
    """Return frame and foot of the steps of each person if frames come at a rate."""
    tables = GaitTables()
    for index, (_, _, results) in enumerate(run):
        tables.add_frame(round(index / rate_hz * 1e9), results)
    found: dict[str, list[tuple[float, str]]] = {}
    for track in tables.people:
        for step in tables.steps(track):
            at = step.landed_s * rate_hz
            near = range(int(at) - OWNER_FRAMES, int(at) + OWNER_FRAMES + 1)
            votes = Counter(owner[track, index] for index in near if (track, index) in owner)
            if votes:
                found.setdefault(votes.most_common(1)[0][0], []).append((at, step.foot))
    return found


def counts(known: StepsByEye, published: Sequence[tuple[float, str]]) -> StepCounts:
    """Count the annotated steps that were published, each by the nearest step."""
    inside = [
        (at, foot)
        for at, foot in published
        if any(begin - NEAR_FRAMES <= at <= end + NEAR_FRAMES for begin, end in known.spans)
    ]
    pairs = sorted(
        (abs(at - true.frame), n, k)
        for n, (at, _) in enumerate(inside)
        for k, true in enumerate(known.steps)
        if abs(at - true.frame) <= NEAR_FRAMES
    )
    one, taken = StepCounts(true=len(known.steps)), dict[int, int]()
    for off, n, k in pairs:
        if n not in taken and k not in taken.values():
            taken[n] = k
            one.off_frames.append(off)
            one.other_foot += inside[n][1] != known.steps[k].foot
    one.hidden = sum(step.hidden for step in known.steps)
    one.found = len(taken)
    one.lost = [step for k, step in enumerate(known.steps) if k not in taken.values()]
    one.invented = sum(
        n not in taken and any(begin <= at <= end for begin, end in known.spans)
        for n, (at, _) in enumerate(inside)
    )
    one.published = one.found + one.invented
    return one


def cause_cells(scene: Scene, known: StepsByEye, one: StepCounts, slower: StepCounts) -> list[str]:
    """Return the number of lost steps by the first stage that fails.

    `slower` are the counts of the same points at WALKING_HZ.
    """
    found = Counter(
        "time base"
        if (stage := first_loss(scene, known.person, step.frame, step.foot)) == "steps"
        and step not in slower.lost
        else stage
        for step in one.lost
    )
    return [str(found[stage]) for stage in STAGES]


def on_depth(run: Run, names: Sequence[str]) -> tuple[int, int]:
    """Return the number of measured points near the depth of their pixels, and of all points."""
    near = known = 0
    for info, frame, results in run:
        for one in results:
            points = [p for p in one.person.points if p.state == "measured" and p.name in names]
            if points:
                here_m = apply(
                    invert(frame.fixed_from_optical), np.array([p.position_m for p in points])
                )
                for point_m, pixel in zip(here_m, project(here_m, info), strict=True):
                    known += 1
                    near += _has_depth(frame, point_m, pixel)
    return near, known


def _has_depth(frame: GaitFrame, point_m: F64, pixel: F64) -> bool:
    u, v = np.rint(pixel).astype(int)
    rows, columns = (slice(max(at - AROUND_PX, 0), at + AROUND_PX + 1) for at in (v, u))
    depth_m = frame.depth_mm[rows, columns] / 1000.0
    return bool((np.abs(depth_m[depth_m > 0] - point_m[2]) <= SAME_M).any())


def main() -> None:
    """Compare, and write the report."""
    parser = options.parser(__doc__, "shared")
    parser.add_argument("--set", dest="settings", action="append", default=[], help="as people4d")
    arguments = parser.parse_args()
    data = arguments.shared / "data" / "rgbd"
    known = msgspec.json.decode((MARKS / "filinha_steps.json").read_bytes(), type=_StepFile)
    marks = read_frames(MARKS / "filinha.json")
    mount = (
        f"camera.mount_xyz_m={list(MOUNT_XYZ_M)}",
        f"camera.mount_rpy_rad={list(MOUNT_RPY_RAD)}",
    )
    steps, depth, causes = [], [], []
    for name, (rate_hz, settings) in PLAYED.items():
        rate = f"camera.options.fps={rate_hz:g}"
        run = play(data / "filinha", (rate, *mount, *settings, *arguments.settings))
        scene = Scene(run, owners(run, marks))
        found = published_steps(run, scene.owner, rate_hz)
        slower = published_steps(run, scene.owner, WALKING_HZ)
        halves = {"choose": StepCounts(), "judge": StepCounts()}
        for person in known.people:
            one = counts(person, found.get(person.person, ()))
            halves[person.half].add(one)
            again = counts(person, slower.get(person.person, ()))
            causes.append(
                [name, person.person, person.half, *cause_cells(scene, person, one, again)]
            )
            steps.append([name, person.person, person.half, *one.cells()])
        steps += [[name, "all", half, *one.cells()] for half, one in halves.items()]
        depth.append(_depth_row(f"filinha, {name}", [run]))
    bags = [
        play(data / "tue" / f"{bag}.bag", (), _box_about(torso)) for bag, torso in TORSO_MM.items()
    ]
    depth.append(_depth_row("TUE, one person by a box", bags))
    columns = ("by eye", "of them hidden", "published", "found", "other foot", "invented")
    header = ["played at", "person", "half", *columns, "off: median frames"]
    write(
        __file__,
        "Gait of real people",
        INTRO.strip(),
        markdown(header, steps),
        CAUSES.strip() + "\n\n" + "\n".join(f"- {name}: {text}" for name, text in STAGES.items()),
        markdown(["played at", "person", "half", *STAGES], causes),
        markdown(["recording", "all points on the depth", "hands", "feet"], depth),
    )


def _box_about(torso: Iterable[Pixel]) -> BoxCorners:
    """Return the box of a standing person by the annotated torso."""
    middle = float(np.mean([u for u, _ in torso]))
    return middle - TORSO_HALF_PX, TORSO_TOP_PX, middle + TORSO_HALF_PX, 479.0


def _depth_row(name: str, runs: Sequence[Run]) -> list[str]:
    cells = [name]
    for names in (("head", *LIMBS), LIMBS[:2], LIMBS[2:]):
        both = np.array([on_depth(run, names) for run in runs]).sum(axis=0).tolist()
        cells.append(f"{both[0]} of {both[1]}")
    return cells
