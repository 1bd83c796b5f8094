"""The cascade: boxes tracked by colour, bodies segmented in boxes, points tracked on bodies."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from common.geometry.boxes import iou_xyxy
from people4d.messages import F32, F64, U8, U16, CameraInfo
from services.gait.colour.colour_layer import ColourLayer
from services.gait.config import CascadeConfig
from services.gait.points.body import MeshObservation
from services.gait.points.depth_layer import DepthLayer
from services.gait.points.point_filter import PointEstimate
from services.gait.points.single_feature import SingleFeatureLayer
from services.gait.surface.floor import FloorDetector
from services.gait.surface.mesh import build_mesh
from services.gait.surface.segmentation import BodySegment, segment_body

BOX_MARGIN = 0.06  # Widening of a detected box, which may miss a hand [heights]
COLOUR_MARGIN = 0.12  # Widening of a box of the colour layer [heights]
FORGET_S = 2.0  # Maximum age of the last observation of a person [s]
GAP_S = 1.0  # Maximum time between frames of a tracked point [s]
SAME_BOX_IOU = 0.7  # Minimum IoU with a detected box for a box of the colour layer to continue


@dataclass(frozen=True)
class PersonObservation:
    """Observation of one person in a frame by tracker and detector."""

    id: int
    box_xyxy_px: F64 | None = None  # 4; None: not detected in this frame
    keypoints: F32 | None = None  # 17x3: u, v, confidence, COCO order
    depth_m: float | None = None  # [m] depth of the person's middle along the optical axis
    yaw_rad: float | None = None  # [rad] of the chest in the fixed frame; None: not known


@dataclass(frozen=True)
class GaitEstimate:
    """One person's points in a frame."""

    id: int
    box_xyxy_px: F64 | None  # 4; None: not known
    points: Mapping[str, PointEstimate]


@dataclass
class _PersonState:
    layer: DepthLayer | SingleFeatureLayer
    box: F64 | None = None
    depth_m: float | None = None
    detected_ns: int = 0  # [ns] stamp of the last detected box
    observed_ns: int = 0  # [ns] stamp of the last observation
    processed_ns: int | None = None  # [ns] stamp of the last estimate


class Cascade:
    """Tracks the points of any number of people.

    Source: docs/method.md, section 8 (G 5).
    """

    def __init__(self, config: CascadeConfig, info: CameraInfo) -> None:
        self._config, self._info = config, info
        self._colours = ColourLayer(config.colour, config.seed)
        self._floor = FloorDetector(info, config.seed)
        self._people: dict[int, _PersonState] = {}
        self._stamp_ns = 0
        self._fixed_from_optical: F64 = np.eye(4)  # pose of the camera

    @property
    def people(self) -> tuple[int, ...]:
        """Ids of the tracked people."""
        return tuple(self._people)

    def update_people(
        self,
        stamp_ns: int,
        rgb: U8,
        depth_mm: U16,
        observations: Sequence[PersonObservation],
        fixed_from_optical: F64 | None = None,
    ) -> list[GaitEstimate]:
        """Return the points of the observed people, in the order of their observations.

        `fixed_from_optical` is the camera's pose, 4x4; None if it is at rest. A stamp before the
        last one resets the cascade; people unobserved for FORGET_S are deleted.
        """
        if stamp_ns < self._stamp_ns:
            self._reset()
        self._stamp_ns = stamp_ns
        self._fixed_from_optical = np.eye(4) if fixed_from_optical is None else fixed_from_optical
        self._add_and_delete(stamp_ns, observations)
        self._update_boxes(stamp_ns, rgb, observations)
        self._floor.update_floor(depth_mm)
        return [self._estimate(one, depth_mm) for one in observations]

    def mark_point(self, person: int, name: str, pixel: F64, depth_mm: U16) -> bool:
        """Start a point of POINTS at a pixel (u, v) of the last frame.

        Returns:
            True if the pixel is on the body of the person of this id.
        """
        state = self._people.get(person)
        body = self._segment(state, depth_mm) if state is not None else None
        if state is None or body is None:
            return False
        mesh = build_mesh(body, self._info)
        vertex = int(mesh.vertices_at(pixel)[0])
        if vertex < 0:
            return False
        observation = MeshObservation(mesh, 0.0, floor=self._floor.floor)
        return state.layer.start_point(name, mesh.points_m[vertex], observation)

    def _reset(self) -> None:
        for person in list(self._people):
            self._colours.stop_person(person)
        self._people.clear()

    def _new_layer(self, person: int) -> DepthLayer | SingleFeatureLayer:
        config = self._config.depth
        if config.feature == "combined":
            return DepthLayer(config, self._info)
        seed = hash((self._config.seed, person)) % 2**32
        return SingleFeatureLayer(config, self._info, seed)

    def _add_and_delete(self, stamp_ns: int, observations: Sequence[PersonObservation]) -> None:
        for one in observations:
            if one.id not in self._people:
                self._people[one.id] = _PersonState(self._new_layer(one.id))
            self._people[one.id].observed_ns = stamp_ns
        limit_ns = stamp_ns - round(FORGET_S * 1e9)
        for person in [p for p, state in self._people.items() if state.observed_ns < limit_ns]:
            self._people.pop(person)
            self._colours.stop_person(person)

    def _update_boxes(
        self, stamp_ns: int, rgb: U8, observations: Sequence[PersonObservation]
    ) -> None:
        """Set the boxes: detected ones, and boxes of the colour layer for the other people."""
        detected = {one.id: box for one in observations if (box := _valid_box(one)) is not None}
        missed = [one.id for one in observations if one.id not in detected]
        tracked = any(person in self._colours.people for person in missed)
        found = self._colours.update_boxes(rgb) if tracked else {}
        for person, box in detected.items():
            state, estimate = self._people[person], found.get(person)
            if estimate is None or iou_xyxy(estimate.box_xyxy_px, box)[0, 0] < SAME_BOX_IOU:
                self._colours.start_person(person, rgb, box)
            state.box, state.detected_ns = box, stamp_ns
        for person in missed:
            state, estimate = self._people[person], found.get(person)
            late = stamp_ns - state.detected_ns > self._config.carry_s * 1e9
            if estimate is None or late or estimate.distance > self._config.colour_distance_max:
                state.box = None
                self._colours.stop_person(person)
            else:
                state.box = estimate.box_xyxy_px
        for one in observations:
            if one.depth_m is not None and np.isfinite(one.depth_m) and one.depth_m > 0:
                self._people[one.id].depth_m = float(one.depth_m)

    def _estimate(self, one: PersonObservation, depth_mm: U16) -> GaitEstimate:
        state = self._people[one.id]
        before_ns = self._stamp_ns if state.processed_ns is None else state.processed_ns
        elapsed_s = (self._stamp_ns - before_ns) / 1e9
        if elapsed_s > GAP_S:
            state.layer.mark_lost()
        body = self._segment(state, depth_mm)
        mesh = build_mesh(body, self._info) if body is not None else None
        state.processed_ns = self._stamp_ns
        points = state.layer.update_points(
            MeshObservation(
                mesh,
                elapsed_s,
                one.keypoints,
                self._floor.floor,
                depth_mm,
                self._fixed_from_optical,
                one.yaw_rad,
            )
        )
        if mesh is not None:
            state.depth_m = float(mesh.middle_m[2])
        return GaitEstimate(one.id, state.box, points)

    def _segment(self, state: _PersonState, depth_mm: U16) -> BodySegment | None:
        """Segment a person in the depth image; None if there is no box or body."""
        if state.box is None:
            return None
        by_colour = state.detected_ns != self._stamp_ns
        ratio = COLOUR_MARGIN if by_colour else BOX_MARGIN
        margin = ratio * (state.box[3] - state.box[1])
        box = state.box + margin * np.array([-1.0, -1.0, 1.0, 1.0])
        return segment_body(self._floor.remove_floor(depth_mm, box), box, state.depth_m)


def _valid_box(observation: PersonObservation) -> F64 | None:
    """Return the box of an observation; None if it is absent, not finite or empty."""
    if observation.box_xyxy_px is None:
        return None
    box = np.asarray(observation.box_xyxy_px, np.float64)
    valid = box.shape == (4,) and np.all(np.isfinite(box)) and np.all(box[:2] < box[2:])
    return box if valid else None
