"""Films of people from head to foot, with the truth about their hands, feet and heads.

Films are drawn once and kept with those of `people4d evaluate`, and so is what the detector sees in
them. Drawing all takes about a quarter of an hour on two cores for each seed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import numpy.typing as npt

from common.geometry.transforms import apply
from common.io.images import decompress
from common.io.recording import open_recording
from evaluation.cache import default_folder, key_of
from evaluation.recordings.detections import DetectionJob, detect, read_tracker_input
from lab.drawing.mesh import Material, Mesh
from lab.drawing.renderer import DepthView, draw_depth
from lab.output.chunks import digest_of
from lab.output.render import Outputs, render
from lab.output.sequence import RenderJob
from lab.scenario import FOLDER, load_scenario
from lab.truth.frames import person_views, project_visible
from lab.truth.markers import Footfall, Vertices, footfalls, mark, seen
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

POINTS = ("head", "left_hand", "right_hand", "left_foot", "right_foot")
HANDS_AND_FEET = POINTS[1:]
HAND_M, WIDE_M = 0.22, 0.09  # a hand's length beyond the wrist, and how far it is from the axis
HEAD_M = 0.15  # a head's radius about the middle of the ears
NEAR_M = 0.03  # from the middle of a hand, across the line of sight, to what is seen of it
BASELINE_M = 0.05  # of the right imager, which is not looked at
TRUTH = ("boxes_px", "shares", "points_m", "visible", "marks_m", "marks_visible")

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Frame:
    """What the camera took: time in ns, HxWx3 colour, HxW depth in mm."""

    stamp_ns: int
    rgb: U8
    depth_mm: U16


@dataclass(frozen=True)
class Truth:
    """What is true in N frames about K people and their five points, in the order of POINTS.

    Args:
        boxes_px: NxKx4, of the whole body, cut to the image.
        shares: NxK, of the body's pixels that nothing hides.
        points_m: NxKx5x3, optical frame: what of the surface the camera sees at the middle of the
            head, hand or foot, as one who labels pictures would click; NaN where it is not seen.
        visible: NxKx5.
        marks_m: NxKx5x3: the point of the skin or cloth that was there in the first frame in which
            it was seen, wherever it has gone since.
        marks_visible: NxKx5.
    """

    boxes_px: F64
    shares: F64
    points_m: F64
    visible: Flags
    marks_m: F64
    marks_visible: Flags


class Take:
    """One film with what is true in it and what the detector sees in it.

    Args:
        scenario: Name of one that ships.
        seed: Of light, textures, noise and small differences of motion.
        folder: Where films and results are kept.
    """

    def __init__(self, scenario: str, seed: int, folder: Path | None = None) -> None:
        self.scenario, self.seed = scenario, seed
        self._folder = folder or default_folder()
        self._order = RenderJob(
            scenario=load_scenario(scenario), seed=seed, depth="measured", samples=1
        )
        key = key_of(msgspec.to_builtins(self._order), digest_of(FOLDER.parent))
        self.path = self._folder / "scenes" / f"{scenario}@{seed}-gait-{key[:16]}.mcap"

    @cached_property
    def world(self) -> World:
        """What was before the camera."""
        return World(self._order.scenario, self.seed)

    @property
    def info(self) -> CameraInfo:
        """Calibration."""
        return self.world.info

    def film(self, jobs: int = 1) -> None:
        """Draw the film, unless it was drawn before."""
        if not self.path.exists():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            render(self._order, Outputs(recording=self.path), jobs, _untold)

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order."""
        for _, message in open_recording(self.path).messages(CompressedRgbdFrame):
            assert isinstance(message, CompressedRgbdFrame)
            frame = decompress(message)
            yield Frame(frame.stamp_ns, frame.rgb, frame.depth_mm)

    @cached_property
    def truth(self) -> Truth:
        """What is true in each frame."""
        path = self.path.with_suffix(".points.npz")
        if not path.exists():
            made = _truth(self.world)
            np.savez_compressed(path, **{name: getattr(made, name) for name in TRUTH})
        with np.load(path) as kept:
            return Truth(**{name: kept[name] for name in TRUTH})

    @cached_property
    def footfalls(self) -> list[list[Footfall]]:
        """The steps that each person made."""
        return [footfalls(self.world, k) for k in range(len(self.world.scenario.people))]

    @cached_property
    def map_from_optical(self) -> F64:
        """Pose of the camera, which stands still."""
        return self.world.map_from_optical(0.0)

    @cached_property
    def sightings(self) -> list[list[Detection | None]]:
        """What the detector sees of each person in each frame, None where it misses them."""
        camera = CameraConfig(source=str(self.path))
        kept = detect(DetectionJob(self.path, camera, DetectorConfig(), (), self._folder))
        by_stamp = {
            message.stamp_ns: message.detections
            for message in read_tracker_input(kept.detections, None)
            if isinstance(message, Detections)
        }
        stamps = [self.world.stamp_ns(index) for index in range(len(self.truth.boxes_px))]
        return [
            _assigned(by_stamp.get(stamp, ()), boxes)
            for stamp, boxes in zip(stamps, self.truth.boxes_px, strict=True)
        ]


def _untold(_text: str, _share: float) -> None:
    """Tell nobody how far the drawing is."""


def overlap(one_px: F64, other_px: F64) -> float:
    """Return the intersection over union of two boxes, xyxy; 0 of what is no box."""
    low, high = np.maximum(one_px[:2], other_px[:2]), np.minimum(one_px[2:], other_px[2:])
    common = float(np.prod(np.maximum(high - low, 0.0)))
    both = float(np.prod(one_px[2:] - one_px[:2]) + np.prod(other_px[2:] - other_px[:2])) - common
    return common / both if both > 0 and np.isfinite(both) else 0.0


def _assigned(people: Sequence[Detection], boxes_px: F64) -> list[Detection | None]:
    """Return which detection is of which person: a tracker that never errs would say so."""
    found: list[Detection | None] = []
    for box_px in boxes_px:
        alike = [overlap(np.asarray(p.box_xyxy_px, np.float64), box_px) for p in people]
        best = int(np.argmax(alike)) if alike else -1
        found.append(people[best] if alike and alike[best] > 0.4 else None)
    return found


def _truth(world: World) -> Truth:
    people = range(len(world.scenario.people))
    first = world.meshes(0.0)
    patches = [_patches(first[k], world.keypoints_m(0.0)[k]) for k in people]
    rows: list[list[npt.NDArray[Any]]] = []
    followed: list[Vertices] = [np.full(len(POINTS), -1, np.int64) for _ in people]
    for index in range(world.frame_count):
        t_s = world.frame_s(index)
        meshes = world.meshes(t_s)
        pose = world.optical_from_map(t_s)
        view = draw_depth([world.room.mesh, *meshes], pose, world.info, BASELINE_M)
        views = person_views(world, t_s, view, meshes)
        bodies = [apply(pose, mesh.vertices_m) for mesh in meshes]
        points = np.array([_clicked(world, view, k, bodies[k], patches[k]) for k in people])
        _follow(world, t_s, points, followed)
        pairs = zip(bodies, followed, strict=True)
        marks = np.array([body[np.maximum(vertices, 0)] for body, vertices in pairs])
        sees = [seen(world, marks[k], view.depth_m, view.owners, k) for k in people]
        marks_seen = np.array(sees, bool) & (np.array(followed) >= 0)
        boxes = np.array([person.box_xyxy_px for person in views])
        shares = np.array([person.visible_share for person in views])
        known = np.isfinite(points).all(axis=2)
        rows.append([boxes, shares, points, known, marks, marks_seen])
    return Truth(*(np.array(column) for column in zip(*rows, strict=True)))


def _follow(world: World, t_s: float, points_m: F64, followed: list[Vertices]) -> None:
    """Mark the points that are seen for the first time."""
    map_from_optical = world.map_from_optical(t_s)
    for k, vertices in enumerate(followed):
        new = (vertices < 0) & np.isfinite(points_m[k]).all(axis=1)
        if new.any():
            in_map = points_m[k][new] @ map_from_optical[:3, :3].T + map_from_optical[:3, 3]
            vertices[new] = mark(world, k, t_s, in_map)


def _patches(mesh: Mesh, keypoints_m: F64) -> list[Vertices]:
    """Return the vertices of head, hands and feet, in the order of POINTS."""
    skin = _made_of(mesh, Material.SKIN)
    places = mesh.vertices_m
    ears = keypoints_m[[3, 4]].mean(axis=0)
    face = _made_of(mesh, Material.SKIN, Material.HAIR, Material.EYE)
    found = [face[np.linalg.norm(places[face] - ears, axis=1) < HEAD_M]]
    for wrist, elbow in ((9, 7), (10, 8)):
        axis = keypoints_m[wrist] - keypoints_m[elbow]
        axis /= np.linalg.norm(axis)
        offsets = places[skin] - keypoints_m[wrist]
        along = offsets @ axis
        wide = np.linalg.norm(offsets - along[:, None] * axis, axis=1)
        found.append(skin[(along > 0) & (along < HAND_M) & (wide < WIDE_M)])
    shoes = _made_of(mesh, Material.SHOE)
    away = np.linalg.norm(places[shoes][:, None] - keypoints_m[[15, 16]], axis=2)
    nearer = away.argmin(axis=1)
    return [*found, shoes[nearer == 0], shoes[nearer == 1]]


def _made_of(mesh: Mesh, *materials: Material) -> Vertices:
    return np.unique(mesh.faces[np.isin(mesh.material, materials)]).astype(np.int64)


def _clicked(
    world: World, view: DepthView, person: int, body_m: F64, patches: Sequence[Vertices]
) -> F64:
    """Return what the camera sees nearest to the middle of each patch: 5x3, NaN where hidden."""
    found = np.full((len(patches), 3), np.nan)
    for row, patch in enumerate(patches):
        places = body_m[patch]
        middle = places.mean(axis=0)
        ray = middle / np.linalg.norm(middle)
        offsets = places - middle
        aside = np.linalg.norm(offsets - (offsets @ ray)[:, None] * ray, axis=1)
        shown = seen(world, places, view.depth_m, view.owners, person).astype(bool)
        aside[~shown] = np.inf
        best = int(aside.argmin())
        if aside[best] < NEAR_M:
            found[row] = places[best]
    return found


def picture(take: Take, index: int) -> U8:
    """Return a frame with boxes and points drawn in, for eyes that check the truth."""
    frame = next(frame for n, frame in enumerate(take.frames()) if n == index)
    image = frame.rgb.copy()
    truth = take.truth
    for k, box in enumerate(truth.boxes_px[index]):
        corners = np.rint(box).astype(int).tolist()
        cv2.rectangle(image, corners[:2], corners[2:], (255, 255, 0), 1)
        sets = ((truth.points_m, truth.visible, 0), (truth.marks_m, truth.marks_visible, 255))
        for points, visible, blue in sets:
            for point, shown in zip(points[index, k], visible[index, k], strict=True):
                if shown:
                    pixel = project_visible(point[None], take.info)[0]
                    cv2.circle(image, np.rint(pixel).astype(int).tolist(), 4, (255, 0, blue), 1)
    return image
