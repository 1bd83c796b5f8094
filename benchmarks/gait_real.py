"""Steps and points of real people against annotated landings and the depth of their bodies.

The recordings show identifiable people and are not part of the repository: `--shared` names the
folder that holds them. Annotated landings are in `real_people_marks/filinha_steps.json`.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.gait_bodies import NO_KEYPOINTS
from benchmarks.lib import options
from benchmarks.lib.gait.causes import STAGES, Scene, first_loss
from benchmarks.lib.gait.event_peers import peer_landings
from benchmarks.lib.gait.steps_by_eye import (
    Landing,
    StepCounts,
    StepFile,
    StepsByEye,
    by_person,
    counts,
)
from benchmarks.lib.marks.crossing import MOUNT_RPY_RAD, MOUNT_XYZ_M, TORSO_MM, Pixel
from benchmarks.lib.table import markdown, write
from common.geometry.transforms import apply, invert, project
from evaluation.annotations.marks import Mark, read_frames
from evaluation.gait.parameters import gait_parameters
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
PEERS = """
Steps by event detectors of other packages that need neither angles nor heels and toes, on the same
positions of body and feet along the path:
"""
CADENCE = """
Cadence of the track with the most frames of each person, beside the annotated steps, with its 95 %
interval:
"""
Run = list[tuple[CameraInfo, GaitFrame, Sequence[GaitResult]]]


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


def tables_at(run: Run, rate_hz: float) -> GaitTables:
    """Return the tables of a run if frames come at a rate."""
    tables = GaitTables()
    for index, (_, _, results) in enumerate(run):
        tables.add_frame(round(index / rate_hz * 1e9), results)
    return tables


def published_steps(
    tables: GaitTables, owner: Mapping[tuple[int, int], str], rate_hz: float
) -> dict[str, list[Landing]]:
    """Return frame and foot of the steps of each person."""
    landed = {
        track: [(step.landed_s, step.foot) for step in tables.steps(track)]
        for track in tables.people
    }
    return by_person(landed, owner, rate_hz)


def cadence_cells(tables: GaitTables, scene: Scene, known: StepsByEye, rate_hz: float) -> list[str]:
    """Return the cadence by eye and of the track with the most frames, with its interval."""
    spans_s = [
        [step.frame / rate_hz for step in known.steps if begin <= step.frame <= end]
        for begin, end in known.spans
    ]
    walked_s = sum(times_s[-1] - times_s[0] for times_s in spans_s if times_s)
    by_eye = 60 * sum(max(len(times_s) - 1, 0) for times_s in spans_s) / walked_s
    tracks = Counter(track for (track, _), name in scene.owner.items() if name == known.person)
    steps = tables.steps(tracks.most_common(1)[0][0]) if tracks else []
    one = next(p for p in gait_parameters(steps) if p.name == "cadence")
    if one.value is None:
        return [f"{by_eye:.0f}", "-", "-", "-"]
    interval = "-" if one.low is None or one.high is None else f"{one.low:.0f} to {one.high:.0f}"
    off = 100 * (one.value / by_eye - 1)
    return [f"{by_eye:.0f}", f"{one.value:.0f}", f"{off:+.0f}", interval]


def peer_rows(
    name: str, run: Run, scene: Scene, known: Iterable[StepsByEye], python: str
) -> list[list[str]]:
    """Return the steps that the detectors of other packages find."""
    rate_hz = PLAYED[name][0]
    tables, rows = tables_at(run, rate_hz), []
    walks = {str(track): tables.trajectories(track) for track in tables.people}
    for method, landings in peer_landings(python, walks).items():
        landed = {int(track): one for track, one in landings.items()}
        found, total = by_person(landed, scene.owner, rate_hz), StepCounts()
        for person in known:
            total.add(counts(person, found.get(person.person, ())))
        cells = total.cells()
        rows.append([name, method, cells[3], str(total.other_foot), str(total.invented)])
    return rows


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
    parser.add_argument("--peers", default="", help="interpreter with gaitkit and myogait")
    arguments = parser.parse_args()
    data = arguments.shared / "data" / "rgbd"
    known = msgspec.json.decode((MARKS / "filinha_steps.json").read_bytes(), type=StepFile)
    marks = read_frames(MARKS / "filinha.json")
    mount = (
        f"camera.mount_xyz_m={list(MOUNT_XYZ_M)}",
        f"camera.mount_rpy_rad={list(MOUNT_RPY_RAD)}",
    )
    steps, depth, causes, cadences, peers = [], [], [], [], []
    for name, (rate_hz, settings) in PLAYED.items():
        rate = f"camera.options.fps={rate_hz:g}"
        run = play(data / "filinha", (rate, *mount, *settings, *arguments.settings))
        scene = Scene(run, owners(run, marks))
        tables = tables_at(run, rate_hz)
        found = published_steps(tables, scene.owner, rate_hz)
        slower = published_steps(tables_at(run, WALKING_HZ), scene.owner, WALKING_HZ)
        if arguments.peers:
            peers += peer_rows(name, run, scene, known.people, arguments.peers)
        halves = {"choose": StepCounts(), "judge": StepCounts()}
        for person in known.people:
            one = counts(person, found.get(person.person, ()))
            halves[person.half].add(one)
            again = counts(person, slower.get(person.person, ()))
            causes.append(
                [name, person.person, person.half, *cause_cells(scene, person, one, again)]
            )
            steps.append([name, person.person, person.half, *one.cells()])
            cells = cadence_cells(tables, scene, person, rate_hz)
            cadences.append([name, person.person, person.half, *cells])
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
        CADENCE.strip(),
        markdown(
            ["played at", "person", "half", "by eye", "cadence", "off %", "interval"], cadences
        ),
        PEERS.strip(),
        markdown(["played at", "detector", "found", "other foot", "invented"], peers),
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
