"""Scenes for the chosen person: rendered people, and long scenes with their crops.

Long scenes have detections from geometry, of people who leave the view for up to a minute and
return. Each crop is the embedding of a rendered crop of one person: the yaw to the camera is the
nearest one or one of its neighbours, the same neighbour for a second. The seeds were written down
before the first run; constants are chosen on the tuning seeds.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from common.geometry.transforms import apply
from common.io.recording import RecordingWriter, open_recording
from evaluation.cache import key_of
from evaluation.recordings.ground_truth import TruthFrame
from evaluation.recordings.recordings import EvaluationRecording
from evaluation.run.run import EvaluationRun
from lab.bodies.cast import cast_names
from lab.camera.plan import CameraPlan, Drive
from lab.output.sequence import RenderJob
from lab.scenario import CapturePlan, PersonPlan, Scenario, Waypoint
from people4d.messages import F64, Detections, Embeddings

# Seeds of long scenes, and of rendered scenes with own and with dark clothes
SEEDS: dict[str, tuple[range, dict[str, tuple[int, ...]]]] = {
    "tuning": (range(1, 5), {"own": (1, 2, 3), "dark": (11, 12, 13)}),
    "judging": (range(50, 56), {"own": (50, 51), "dark": (50,)}),
}
RENDERED = "lab:random?people=4&duration_s=30&width=320&height=240&outfit="
DURATION_S, FPS = 150.0, 10.0
ABSENCE_S = 55.0  # maximum stop out of view [s]; the way there and back takes longer
LEAVES = 0.35  # share of the positions out of view
STOP_S = 4.0  # maximum stop in view [s]
NEAR_M = 0.6  # maximum distance on the ground of a detection from its person [m]
SHARE_MIN = 0.6  # minimum visible share of a person in a crop
NEIGHBOURS = 5  # number of crops with the nearest yaws
# Path of a robot: back and forth, with turns
DRIVES = (
    Drive(for_s=6.0, speed_mps=0.25, turn_dps=3.0),
    Drive(for_s=6.0, speed_mps=-0.25, turn_dps=-3.0),
    Drive(for_s=3.0, turn_dps=-10.0),
    Drive(for_s=3.0, turn_dps=10.0),
)


@dataclass(frozen=True)
class CropBank:
    """Crops of one person."""

    model: str  # name of the embedder
    yaws_rad: F64  # yaws relative to the direction to the camera
    vectors: F64

    def draw(self, yaw_rad: float, neighbour: int) -> F64:
        """Return one of the crops with the nearest yaws."""
        apart = np.abs(np.angle(np.exp(1j * (self.yaws_rad - yaw_rad))))
        return np.asarray(self.vectors[np.argsort(apart)[min(neighbour, len(apart) - 1)]])


def long_scene(seed: int, cache: Path) -> EvaluationRecording:
    """Return the scene of a seed: three to six people; the robot drives if the seed is odd."""
    rng = np.random.default_rng([seed, 0x7A26])
    people = tuple(
        PersonPlan(
            body=cast_names()[k],
            start=(2.0 + 0.6 * k, 0.4 - 0.8 * (k % 2)),
            speed_mps=float(rng.uniform(0.6, 1.3)),
            path=tuple(_path(rng)),
            repeat=True,
        )
        for k in range(3 + seed % 4)
    )
    drive = DRIVES * math.ceil(DURATION_S / sum(one.for_s for one in DRIVES)) if seed % 2 else ()
    scene = Scenario(
        name=f"follow_{seed}",
        about="People leave the view and return.",
        duration_s=DURATION_S,
        seed=seed,
        room="square",
        camera=CameraPlan(fps=FPS, drive=drive),
        capture=CapturePlan(rate_hz=2 * FPS),
        people=people,
    )
    job = RenderJob(scenario=scene, seed=seed, fidelity="geometry")
    path = cache / "scenes" / f"{scene.name}-{key_of(job)[:16]}.mcap"
    return EvaluationRecording(scene.name, scene.name, path, seed, scene, job)


def _path(rng: np.random.Generator) -> Iterator[Waypoint]:
    """Yield positions in view and beside it, with stops."""
    for _ in range(20):
        x_m = float(rng.uniform(1.8, 5.0))
        if rng.random() < LEAVES:
            y_m = float(rng.choice((-1, 1))) * (0.75 * x_m + 0.8)
            yield Waypoint(to=(x_m, y_m), stop_s=float(rng.uniform(0.0, ABSENCE_S)))
        else:
            stop_s = float(rng.uniform(0.0, STOP_S)) * (rng.random() < 0.4)
            y_m = float(rng.uniform(-0.4, 0.4)) * x_m
            yield Waypoint(to=(x_m, y_m), stop_s=stop_s, face_deg=float(rng.uniform(-180.0, 180.0)))


def crop_banks(run: EvaluationRun) -> list[CropBank]:
    """Return the crops of each person of a rendered scene."""
    assert run.embeddings
    detections = [m for _, m in open_recording(run.detections).messages(Detections)]
    frames = dict(zip((m.stamp_ns for m in detections), run.truth.frames, strict=True))
    found: dict[str, list[tuple[float, F64]]] = {}
    by_stamp, model = {m.stamp_ns: m for m in detections}, ""
    for _, message in open_recording(run.embeddings).messages(Embeddings):
        assert isinstance(message, Embeddings)
        boxes, frame, model = by_stamp[message.stamp_ns], frames[message.stamp_ns], message.model
        assert isinstance(boxes, Detections)
        for index, vector in zip(message.detections, message.vectors, strict=True):
            match = _person_at(frame, boxes.detections[index].position_m)
            if frame and match and frame.shares.get(match[0], 1.0) >= SHARE_MIN:
                found.setdefault(match[0], []).append((match[1], vector.astype(np.float64)))
    banks = [
        CropBank(model, np.array([yaw for yaw, _ in one]), np.array([v for _, v in one]))
        for _, one in sorted(found.items())
    ]
    return [bank for bank in banks if len(bank.yaws_rad) >= 2 * NEIGHBOURS]


def _person_at(frame: TruthFrame | None, position_m: F64 | None) -> tuple[str, float] | None:
    """Return the person at a position in the camera, and the yaw relative to the camera."""
    if frame is None or frame.map_from_camera is None or position_m is None:
        return None
    at_m, camera_m = apply(frame.map_from_camera, position_m), frame.map_from_camera[:3, 3]
    near = min(
        (p for p in frame.people if p.yaw_rad is not None),
        key=lambda p: math.dist(p.position_m[:2], at_m[:2]),
        default=None,
    )
    if near is None or near.yaw_rad is None or math.dist(near.position_m[:2], at_m[:2]) > NEAR_M:
        return None
    y_m, x_m = (camera_m - near.position_m)[1::-1].tolist()
    return near.id, near.yaw_rad - math.atan2(y_m, x_m)


def with_crops(run: EvaluationRun, banks: Sequence[CropBank], cache: Path) -> EvaluationRun:
    """Return the run of a long scene with embeddings of rendered people."""
    path = cache / "embeddings" / f"{run.recording.name}-crops.mcap"
    path.parent.mkdir(parents=True, exist_ok=True)
    banks_of = dict(zip(run.truth.ids, banks, strict=False))
    messages = [m for _, m in open_recording(run.detections).messages(Detections)]
    with RecordingWriter(path) as writer:
        for message, frame in zip(messages, run.truth.frames, strict=True):
            assert isinstance(message, Detections)
            rows = dict[int, F64]()
            for index, detection in enumerate(message.detections):
                match = _person_at(frame, detection.position_m)
                if match and match[0] in banks_of:
                    rows[index] = _crop(banks_of, match, message.stamp_ns)
            writer.write(_embeddings(message, rows, banks[0]), message.stamp_ns)
    return replace(run, embeddings=path)


def _crop(banks: Mapping[str, CropBank], match: tuple[str, float], stamp_ns: int) -> F64:
    person, yaw_rad = match
    rng = np.random.default_rng([*person.encode(), stamp_ns // 1_000_000_000])
    return banks[person].draw(yaw_rad, int(rng.integers(NEIGHBOURS)))


def _embeddings(message: Detections, rows: Mapping[int, F64], bank: CropBank) -> Embeddings:
    shape = (len(rows), bank.vectors.shape[1])
    return Embeddings(
        stamp_ns=message.stamp_ns,
        sequence=message.sequence,
        camera=message.camera,
        model=bank.model,
        detections=tuple(rows),
        vectors=np.array(list(rows.values()), np.float32).reshape(shape),
    )
