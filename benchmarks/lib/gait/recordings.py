"""Rendered recordings of entire people, with the ground truth of heads, hands and feet.

Recordings and detections are in the cache of `people4d evaluate`. Rendering takes about 15 minutes
on two cores for each seed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from benchmarks.lib.gait.truth import references
from common.geometry.transforms import apply
from common.io.images import decompress
from common.io.recording import open_recording
from evaluation.cache import default_folder, key_of
from evaluation.recordings.detections import DetectionJob, detect, read_tracker_input
from lab.catalogue import FOLDER, load_scenario
from lab.drawing.mesh import Material, Mesh
from lab.drawing.renderer import DepthView, draw_depth
from lab.output.chunks import digest_of
from lab.output.render import Outputs, render
from lab.output.sequence import RenderJob
from lab.truth.frames import person_views, visible_points
from lab.truth.motion_capture import Footfall, footfalls
from lab.world import World
from people4d.messages import (
    F64,
    U8,
    U16,
    CameraInfo,
    CompressedRgbdFrame,
    Detection,
    Detections,
)
from services.camera.config import CameraConfig
from services.detector.config import DetectorConfig
from services.gait.config import POINTS_MODEL

DETECTOR = DetectorConfig(model=POINTS_MODEL)
POINTS = ("head", "left_hand", "right_hand", "left_foot", "right_foot")
HANDS_AND_FEET = POINTS[1:]
HAND_M, WIDE_M = 0.22, 0.09  # Length of a hand beyond the wrist, and radius about the axis [m]
HEAD_M = 0.15  # Radius of a head about the middle of the ears [m]
NEAR_M = 0.03  # Maximum distance of the visible surface to the ray of the middle [m]
BASELINE_M = 0.05  # Baseline of the unused right imager [m]
TRUTH = ("boxes_px", "points_m", "visible")

Flags = npt.NDArray[np.bool_]
Vertices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class RecordedFrame:
    """Frame of the camera: time in ns, HxWx3 colour, HxW depth in mm."""

    stamp_ns: int
    rgb: U8
    depth_mm: U16


@dataclass(frozen=True)
class PointTruth:
    """Ground truth of N frames, K people and five points in the order of POINTS.

    Args:
        boxes_px: NxKx4, of the entire body, clipped to the image.
        points_m: NxKx5x3, optical frame: visible surface at the middle of the head, hand or foot;
            NaN where occluded.
        visible: NxKx5.
    """

    boxes_px: F64
    points_m: F64
    visible: Flags


class GaitRecording:
    """One rendered recording with its ground truth and detections.

    Args:
        scenario: Name of a shipped scenario.
        seed: Seed of light, textures, noise and small differences of motion.
        folder: Cache of recordings and results.
    """

    def __init__(self, scenario: str, seed: int, folder: Path | None = None) -> None:
        self.scenario, self.seed = scenario, seed
        self._folder = folder or default_folder()
        self._job = RenderJob(
            scenario=load_scenario(scenario), seed=seed, depth="measured", samples=1
        )
        key = key_of(msgspec.to_builtins(self._job), digest_of(FOLDER.parent))
        self.path = self._folder / "scenes" / f"{scenario}@{seed}-gait-{key[:16]}.mcap"

    @cached_property
    def world(self) -> World:
        """Simulated people and room."""
        return World(self._job.scenario, self.seed)

    @property
    def info(self) -> CameraInfo:
        """Calibration."""
        return self.world.info

    def render(self, jobs: int = 1) -> None:
        """Render the recording, unless it is cached."""
        if not self.path.exists():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            render(self._job, Outputs(recording=self.path), jobs, lambda _text, _ratio: None)

    def frames(self) -> Iterator[RecordedFrame]:
        """Yield the frames in order."""
        for _, message in open_recording(self.path).messages(CompressedRgbdFrame):
            assert isinstance(message, CompressedRgbdFrame)
            frame = decompress(message)
            yield RecordedFrame(frame.stamp_ns, frame.rgb, frame.depth_mm)

    @cached_property
    def truth(self) -> PointTruth:
        """Ground truth of each frame."""
        path = self.path.with_suffix(".points.npz")
        if not path.exists():
            truth = _truth(self.world)
            np.savez_compressed(path, **{name: getattr(truth, name) for name in TRUTH})
        with np.load(path) as arrays:
            return PointTruth(**{name: arrays[name] for name in TRUTH})

    @cached_property
    def middles_m(self) -> F64:
        """Middles of hands and feet as the service defines them, by joints, and heads: NxKx5x3.

        Frame: optical; NaN where the truth is occluded. Unlike the visible surface before the
        middle, which is at the toes in front and at the heel behind, they turn with the foot.
        """
        times_s = [self.world.frame_s(index) for index in range(len(self.truth.boxes_px))]
        joints_m = np.array([self.world.keypoints_m(t_s) for t_s in times_s])
        limbs_m = references(joints_m, np.tile(self.map_from_optical[:3, 3], (len(joints_m), 1)))
        optical = apply(self.world.optical_from_map(0.0), limbs_m.reshape(-1, 3))
        found = self.truth.points_m.copy()
        found[:, :, 1:] = optical.reshape(limbs_m.shape)
        found[~self.truth.visible.astype(bool)] = np.nan
        return found

    @cached_property
    def footfalls(self) -> list[list[Footfall]]:
        """True steps of each person."""
        return [footfalls(self.world, k) for k in range(len(self.world.scenario.people))]

    @cached_property
    def map_from_optical(self) -> F64:
        """Pose of the camera, which is fixed."""
        return self.world.map_from_optical(0.0)

    @cached_property
    def detections(self) -> list[list[Detection | None]]:
        """Detection of each person in each frame, None where missed."""
        camera = CameraConfig(source=str(self.path))
        cached = detect(DetectionJob(self.path, camera, DETECTOR, (), self._folder))
        by_stamp = {
            message.stamp_ns: message.detections
            for message in read_tracker_input(cached.detections, None)
            if isinstance(message, Detections)
        }
        stamps = [self.world.stamp_ns(index) for index in range(len(self.truth.boxes_px))]
        return [
            _assigned(by_stamp.get(stamp, ()), boxes)
            for stamp, boxes in zip(stamps, self.truth.boxes_px, strict=True)
        ]


def overlap(one_px: F64, other_px: F64) -> float:
    """Return the intersection over union of two boxes, xyxy; 0 for an invalid one."""
    low, high = np.maximum(one_px[:2], other_px[:2]), np.minimum(one_px[2:], other_px[2:])
    common = float(np.prod(np.maximum(high - low, 0.0)))
    both = float(np.prod(one_px[2:] - one_px[:2]) + np.prod(other_px[2:] - other_px[:2])) - common
    return common / both if both > 0 and np.isfinite(both) else 0.0


def _assigned(people: Sequence[Detection], boxes_px: F64) -> list[Detection | None]:
    """Return the detection of each true box, as assigned by a perfect tracker."""
    found: list[Detection | None] = []
    for box_px in boxes_px:
        ious = [overlap(np.asarray(p.box_xyxy_px, np.float64), box_px) for p in people]
        best = int(np.argmax(ious)) if ious else -1
        found.append(people[best] if ious and ious[best] > 0.4 else None)
    return found


def _truth(world: World) -> PointTruth:
    people = range(len(world.scenario.people))
    first = world.meshes(0.0)
    patches = [_patches(first[k], world.keypoints_m(0.0)[k]) for k in people]
    rows: list[list[npt.NDArray[Any]]] = []
    for index in range(world.frame_count):
        t_s = world.frame_s(index)
        meshes = world.meshes(t_s)
        pose = world.optical_from_map(t_s)
        view = draw_depth([world.room.mesh, *meshes], pose, world.info, BASELINE_M)
        views = person_views(world, t_s, view, meshes)
        bodies = [apply(pose, mesh.vertices_m) for mesh in meshes]
        points = np.array([_visible(world, view, k, bodies[k], patches[k]) for k in people])
        boxes = np.array([person.box_xyxy_px for person in views])
        rows.append([boxes, points, np.isfinite(points).all(axis=2)])
    return PointTruth(*(np.array(column) for column in zip(*rows, strict=True)))


def _patches(mesh: Mesh, keypoints_m: F64) -> list[Vertices]:
    """Return the vertices of head, hands and feet, in the order of POINTS."""
    skin = _made_of(mesh, Material.SKIN)
    points_m = mesh.vertices_m
    ears = keypoints_m[[3, 4]].mean(axis=0)
    face = _made_of(mesh, Material.SKIN, Material.HAIR, Material.EYE)
    found = [face[np.linalg.norm(points_m[face] - ears, axis=1) < HEAD_M]]
    for wrist, elbow in ((9, 7), (10, 8)):
        axis = keypoints_m[wrist] - keypoints_m[elbow]
        axis /= np.linalg.norm(axis)
        offsets = points_m[skin] - keypoints_m[wrist]
        along = offsets @ axis
        wide = np.linalg.norm(offsets - along[:, None] * axis, axis=1)
        found.append(skin[(along > 0) & (along < HAND_M) & (wide < WIDE_M)])
    shoes = _made_of(mesh, Material.SHOE)
    away = np.linalg.norm(points_m[shoes][:, None] - keypoints_m[[15, 16]], axis=2)
    nearer = away.argmin(axis=1)
    return [*found, shoes[nearer == 0], shoes[nearer == 1]]


def _made_of(mesh: Mesh, *materials: Material) -> Vertices:
    return np.unique(mesh.faces[np.isin(mesh.material, materials)]).astype(np.int64)


def _visible(
    world: World, view: DepthView, person: int, body_m: F64, patches: Sequence[Vertices]
) -> F64:
    """Return the visible vertex nearest to the middle of each patch: 5x3, NaN where occluded."""
    found = np.full((len(patches), 3), np.nan)
    for row, patch in enumerate(patches):
        points_m = body_m[patch]
        middle = points_m.mean(axis=0)
        ray = middle / np.linalg.norm(middle)
        offsets = points_m - middle
        aside = np.linalg.norm(offsets - (offsets @ ray)[:, None] * ray, axis=1)
        unoccluded = visible_points(world, points_m, view.depth_m, view.owners, person).astype(bool)
        aside[~unoccluded] = np.inf
        best = int(aside.argmin())
        if aside[best] < NEAR_M:
            found[row] = points_m[best]
    return found
