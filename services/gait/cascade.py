"""The cascade: colours carry boxes, boxes cut out bodies, and points are followed on them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from common.geometry.boxes import iou_xyxy
from people4d.messages import F32, F64, U8, U16, CameraInfo
from services.gait.cascade_config import CascadeConfig
from services.gait.colour.colour_layer import ColourLayer
from services.gait.points.depth_layer import DepthLayer, Sight
from services.gait.points.point_filter import PointEstimate
from services.gait.surface.body import Body, find_body
from services.gait.surface.floor import FloorFinder
from services.gait.surface.mesh import Surface, surface_of
from services.gait.surface.parts import rows_px_of

__all__ = ["Cascade", "GaitEstimate", "PointEstimate", "Seen"]


@dataclass(frozen=True)
class Seen:
    """What tracker and detector tell of one person in a frame."""

    id: int
    box_xyxy_px: F64 | None = None  # 4; None: not detected in this frame
    keypoints: F32 | None = None  # 17x3: u, v, confidence, COCO order
    depth_m: float | None = None  # of the person's middle, along the optical axis


@dataclass(frozen=True)
class GaitEstimate:
    """One person's points in a frame."""

    id: int
    box_xyxy_px: F64 | None  # 4; None: nobody knows where the person is
    points: Mapping[str, PointEstimate]
    fresh: bool = True  # the person's depth was looked at in this frame
    surface: Surface | None = None  # with keep_details only
    # First rows of head, shoulders, torso and legs by the silhouette; with keep_details only
    rows_px: Mapping[str, int] = field(default_factory=dict)
    particles: Mapping[str, F64] = field(default_factory=dict)  # Nx4 each; with keep_details only


@dataclass
class _Person:
    """What is kept of a person."""

    layer: DepthLayer
    box: F64 | None = None
    depth_m: float | None = None
    detected_ns: int = 0  # when a box was last given
    told_ns: int = 0  # when anybody last told of the person
    looked: int = -1  # number of the frame in which depth was last looked at
    looked_ns: int = 0


class Cascade:
    """Follows the points of any number of people.

    Args:
        config: Of all layers.
        info: Calibration of the camera, which stays the same.

    Source: method book section 8 [G 5].
    """

    def __init__(self, config: CascadeConfig, info: CameraInfo) -> None:
        self._config, self._info = config, info
        self._colours = ColourLayer(config.colour, config.seed)
        self._floor = FloorFinder(config.floor, info, config.seed)
        self._people: dict[int, _Person] = {}
        self._frame = 0
        self._stamp_ns = 0

    @property
    def people(self) -> tuple[int, ...]:
        """Who is followed."""
        return tuple(self._people)

    def update(
        self, stamp_ns: int, rgb: U8, depth_mm: U16, seen: Sequence[Seen]
    ) -> list[GaitEstimate]:
        """Return the points of everyone who is followed, in the order of `seen`.

        Args:
            stamp_ns: Of the frame; frames come in order.
            rgb: HxWx3.
            depth_mm: HxW, 0 = no reading.
            seen: What others tell of people in this frame; of whom nobody tells for a while is
                forgotten.
        """
        if self._frame and stamp_ns < self._stamp_ns:
            self._reset()  # a recording that began anew
        self._stamp_ns = stamp_ns
        self._forget(stamp_ns, seen)
        self._boxes(stamp_ns, rgb, seen)
        self._floor.update(depth_mm)
        chosen = self._turns(seen)
        told = [self._told(one, depth_mm, one.id in chosen) for one in seen]
        self._frame += 1
        return told

    def mark(self, person: int, name: str, pixel: F64, depth_mm: U16) -> bool:
        """Follow one more point of a person, or one of the usual from elsewhere.

        Args:
            person: Who, of those in the last update.
            name: Of the point.
            pixel: 2, u and v in the last frame.
            depth_mm: HxW, of the last frame.

        Returns:
            Whether the pixel is on the person's body.
        """
        kept = self._people.get(person)
        if kept is None or kept.box is None:
            return False
        body = self._body(kept, depth_mm)
        if body is None:
            return False
        surface = surface_of(body, self._info, self._config.body)
        vertex = int(surface.vertices_at(pixel)[0])
        if vertex < 0:
            return False
        sight = Sight(surface, 0.0, floor=self._floor.floor)
        return kept.layer.start(name, surface.points_m[vertex], sight)

    def _reset(self) -> None:
        for person in list(self._people):
            self._colours.stop(person)
        self._people.clear()

    def _forget(self, stamp_ns: int, seen: Sequence[Seen]) -> None:
        for one in seen:
            if one.id not in self._people:
                seed = hash((self._config.seed, one.id)) % 2**32
                layer = DepthLayer(self._config.depth, self._info, seed)
                self._people[one.id] = _Person(layer)
            self._people[one.id].told_ns = stamp_ns
        limit_ns = stamp_ns - round(self._config.forget_s * 1e9)
        for person in [p for p, kept in self._people.items() if kept.told_ns < limit_ns]:
            self._people.pop(person)
            self._colours.stop(person)

    def _boxes(self, stamp_ns: int, rgb: U8, seen: Sequence[Seen]) -> None:
        """Take the boxes that were detected, and let colours carry the others on."""
        given = {one.id: box for one in seen if (box := _checked(one.box_xyxy_px)) is not None}
        carried = [one.id for one in seen if one.id not in given]
        found = self._colours.update(rgb) if any(p in self._colours.people for p in carried) else {}
        for person, box in given.items():
            kept = self._people[person]
            estimate = found.get(person)
            followed = estimate is not None and _alike(estimate.box_xyxy_px, box)
            if not followed:
                self._colours.start(person, rgb, box)
            kept.box, kept.detected_ns = box, stamp_ns
        for person in carried:
            kept = self._people[person]
            estimate = found.get(person)
            late = stamp_ns - kept.detected_ns > self._config.carry_s * 1e9
            if estimate is None or late or estimate.distance > self._config.colour_distance_max:
                kept.box = None
                self._colours.stop(person)
            else:
                kept.box = estimate.box_xyxy_px
        for one in seen:
            if one.depth_m is not None and np.isfinite(one.depth_m) and one.depth_m > 0:
                self._people[one.id].depth_m = float(one.depth_m)

    def _turns(self, seen: Sequence[Seen]) -> set[int]:
        """Return whose depth is looked at in this frame: those whose turn is longest ago."""
        waiting = sorted(
            (one.id for one in seen if self._people[one.id].box is not None),
            key=lambda person: self._people[person].looked,
        )
        return set(waiting[: self._config.people_max])

    def _told(self, one: Seen, depth_mm: U16, fresh: bool) -> GaitEstimate:
        config, kept = self._config, self._people[one.id]
        elapsed_s = (self._stamp_ns - kept.looked_ns) / 1e9 if kept.looked >= 0 else 0.0
        if elapsed_s > config.gap_s:
            kept.layer.interrupt()
        if not fresh and kept.box is not None:
            points = kept.layer.ahead(elapsed_s)
            return GaitEstimate(one.id, kept.box, points, fresh=False)
        body = self._body(kept, depth_mm) if kept.box is not None else None
        surface = surface_of(body, self._info, config.body) if body is not None else None
        kept.looked, kept.looked_ns = self._frame, self._stamp_ns
        sight = Sight(surface, elapsed_s, one.keypoints, self._floor.floor)
        points = kept.layer.update(sight)
        if surface is not None:
            kept.depth_m = float(np.median(surface.points_m[:, 2]))
        details = config.keep_details
        particles = {name: p.particles for name, p in kept.layer.filters.items()}
        return GaitEstimate(
            id=one.id,
            box_xyxy_px=kept.box,
            points=points,
            surface=surface if details else None,
            rows_px=rows_px_of(body, config.body) if details else {},
            particles=particles if details else {},
        )

    def _body(self, kept: _Person, depth_mm: U16) -> Body | None:
        """Return a person's body; None if there is none."""
        assert kept.box is not None
        config = self._config
        carried = kept.detected_ns != self._stamp_ns
        share = config.colour_margin if carried else config.box_margin
        margin = share * (kept.box[3] - kept.box[1])
        box = kept.box + margin * np.array([-1.0, -1.0, 1.0, 1.0])
        return find_body(self._floor.without(depth_mm, box), box, kept.depth_m, config.body)


def _checked(box: F64 | None) -> F64 | None:
    """Return a box as numbers; None if it is none."""
    if box is None:
        return None
    sides = np.asarray(box, np.float64)
    usable = sides.shape == (4,) and np.all(np.isfinite(sides)) and np.all(sides[:2] < sides[2:])
    return sides if usable else None


def _alike(a: F64, b: F64) -> bool:
    return float(iou_xyxy(a, b)[0, 0]) >= 0.7
