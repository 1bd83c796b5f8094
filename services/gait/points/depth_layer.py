"""The depth layer: points of one person's body followed in depth (method book section 8.3)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F32, F64, CameraInfo
from services.gait.points.config import DepthLayerConfig
from services.gait.points.facing import Facing
from services.gait.points.judging import Judge
from services.gait.points.likeness import likeness, reference
from services.gait.points.limbs import Body3d, LimbEnd, body_of, heights_of, lengths_m, limb_ends
from services.gait.points.matching import match
from services.gait.points.point_filter import PointEstimate, PointFilter
from services.gait.points.points import HEAD, PAIRS, SURE, Anchor, anchors, stepped
from services.gait.points.proposals import pixels_of, proposals, sigma_px
from services.gait.points.sides import Sides
from services.gait.points.starting import starts
from services.gait.points.weighing import Hints, alone, together
from services.gait.surface.floor import Floor
from services.gait.surface.geodesic import geodesic_m
from services.gait.surface.mesh import Surface
from services.gait.surface.tips import tips_of
from services.gait.surface.trunk import Trunk

__all__ = ["DepthLayer", "PointEstimate", "Sight"]

MIN_VERTICES = 30  # fewer are no body
PATIENCE = 2  # frames in which a keypoint contradicts a point, until that starts again
WHOLE = 0.94  # of the picture's height: legs that go on below are cut off there
CALM_S = 0.05  # [s] in which a hidden point's own motion dies down
BEGIN_M = 0.05  # [m] of a keypoint to the body, at most, for a point to start there


@dataclass(frozen=True)
class Sight:
    """What is seen of one person in a frame."""

    surface: Surface | None  # None: nothing
    dt_s: float  # since the last frame
    keypoints: F32 | None = None  # 17x3: u, v, confidence, COCO order
    floor: Floor | None = None


class DepthLayer:
    """Follows the points of one person.

    Args:
        config: Which points, models and constants.
        info: Calibration.
        seed: Of the random numbers; the same seed and calls give the same points.

    Source: method book section 8.3.
    """

    def __init__(self, config: DepthLayerConfig, info: CameraInfo, seed: int = 0) -> None:
        self._config, self._info = config, info
        self._generator = np.random.default_rng(seed)
        self._trunk = Trunk(config)
        self._facing = Facing()
        self.facing: F64 | None = None  # 3, level, optical frame
        self._points = {name: self._new(name) for name in config.points}
        self._judge = Judge(config, info)
        self._sides = Sides(config.swap_s)
        self._ends: dict[str, LimbEnd] = {}  # of the points' limbs
        self._stature_m = 0.0
        self._combined = config.feature == "combined"
        self.body: Body3d | None = None  # of the last frame
        self.trust: dict[str, dict[str, float]] = {}  # by point and feature, of the last frame

    @property
    def filters(self) -> Mapping[str, PointFilter]:
        """The particle filters by the names of their points."""
        return self._points

    def start(self, name: str, point_m: F64, sight: Sight) -> bool:
        """Follow a point from now on, or again from here.

        Args:
            name: Of the point; a new name marks one more.
            point_m: 3, optical frame; the nearest vertex is taken.
            sight: The frame that it is of.

        Returns:
            Whether there is a body to mark it on.
        """
        body = self._look(sight)
        if body is None or not np.all(np.isfinite(point_m)):
            return False
        self._start(name, body.surface.nearest(point_m), body, marked=True)
        return True

    def stop(self, name: str) -> None:
        """Follow a point no longer."""
        self._points.pop(name, None)

    def update(self, sight: Sight) -> Mapping[str, PointEstimate]:
        """Return where the points are in the next frame.

        Args:
            sight: What is seen of the person.
        """
        body = self._look(sight)
        if body is None:
            for point in self._points.values():
                self._skip(point, sight.dt_s)
            return self._told()
        found = self._anchors(sight, body)
        ends = self._limb_ends(body) if self._combined or not self._begun() else []
        self._move(sight, found, ends)
        self._weigh(sight, body, found)
        if self._combined:
            self._calm(sight.dt_s)
        self._begin(sight, body, found, ends)
        if not found and self._combined:
            for left, right in self._sides.wrong(self._points, self.facing, sight.dt_s):
                self._exchange(left, right)
        return self._told()

    def ahead(self, dt_s: float) -> Mapping[str, PointEstimate]:
        """Return where the points will be after some time, if nothing is seen of them."""
        return {name: point.ahead(dt_s) for name, point in self._points.items()}

    def interrupt(self) -> None:
        """Nothing was seen for so long that all points are lost."""
        for point in self._points.values():
            point.state = "lost"

    def _new(self, name: str) -> PointFilter:
        return PointFilter(name, self._config, self._info, self._generator)

    def _begun(self) -> bool:
        return all(point.motion is not None for point in self._points.values())

    def _told(self) -> dict[str, PointEstimate]:
        return {name: point.estimate() for name, point in self._points.items()}

    def _skip(self, point: PointFilter, dt_s: float) -> None:
        if point.motion is not None:
            point.motion.predict(dt_s)
        point.missed(dt_s)

    def _look(self, sight: Sight) -> Body3d | None:
        """Measure what all points need: heights, distances along the body, ends of limbs."""
        surface, config = sight.surface, self._config
        self.body = None
        if surface is None or len(surface.points_m) < MIN_VERTICES:
            self.facing = self._facing.update(None, np.empty(0), sight.dt_s)
            return None
        heights = heights_of(surface, sight.floor)
        self.facing = self._facing.update(surface, heights, sight.dt_s)
        self._stature_m = max(0.998 * self._stature_m, float(np.quantile(heights, 0.995)))
        if self._combined or config.source == "body":
            source = self._trunk.vertex(surface, heights, self._stature_m, sight.keypoints)
        else:
            source = int(np.argmax(heights))
        along = geodesic_m(surface, source)
        tips = tips_of(surface, along, config.tip_m)
        self.body = body_of(surface, heights, self._stature_m, along, tips)
        return self.body

    def _limb_ends(self, body: Body3d) -> list[LimbEnd]:
        """Return the ends of limbs that are not merely where the picture ends."""
        margin = 2 * body.surface.step_px
        last = np.array([self._info.width - 1 - margin, WHOLE * self._info.height])
        pixels = body.surface.pixels_px[body.tips.vertices]
        inside = np.all((pixels > margin) & (pixels < last), axis=1)
        return [end for end in limb_ends(body, self._config) if inside[end.basin]]

    def _anchors(self, sight: Sight, body: Body3d) -> Mapping[str, Anchor]:
        """Return where keypoints put the points."""
        if not (self._combined and self._config.keypoints):
            return {}
        found = anchors(sight.keypoints, self._config)
        if self.facing is not None:
            depth_m = float(np.median(body.surface.points_m[:, 2]))
            found = stepped(found, depth_m, self.facing, self._info, self._config)
        return {name: anchor for name, anchor in found.items() if name in self._points}

    def _exchange(self, left: str, right: str) -> None:
        """Give the points of a pair each other's name."""
        points = self._points
        points[left], points[right] = points[right], points[left]
        points[left].name, points[right].name = left, right

    def _move(self, sight: Sight, found: Mapping[str, Anchor], ends: Sequence[LimbEnd]) -> None:
        self._match(found, ends)
        for name, point in self._points.items():
            if point.motion is None:
                continue
            told = found.get(name), self._ends.get(name)
            near = proposals(point, *told, self._info, self._config) if self._combined else []
            point.propagate(sight.dt_s, near)

    def _match(self, found: Mapping[str, Anchor], ends: Sequence[LimbEnd]) -> None:
        """Find which limb each point is at the end of."""
        anchors_m = {
            name: deproject(anchor.pixel, [point.motion.position_m[2]], self._info)[0]
            for name, anchor in found.items()
            if (point := self._points[name]).motion is not None
        }
        self._ends = {}
        for kind in ("head", "hand", "foot"):
            points = [p for p in self._points.values() if p.kind == kind and p.alive]
            same = [end for end in ends if end.kind == kind][:6]
            self._ends |= match(points, same, anchors_m)

    def _weigh(self, sight: Sight, body: Body3d, found: Mapping[str, Anchor]) -> None:
        """Weigh the particles of all points, and take in what they tell."""
        points = [point for point in self._points.values() if point.motion is not None]
        for point in points:
            point.settle(body)
        hints = {point.name: self._hints(point, found.get(point.name)) for point in points}
        weigh = together if self._combined else alone
        weighed = {
            point.name: weigh(point, body, alike, hints[point.name], self._config)
            for point, alike in zip(
                points, likeness(points, body.surface, self._config), strict=True
            )
        }
        for point in points:
            self.trust[point.name] = weighed[point.name].trust
            self._judge.take(point, body, weighed[point.name], hints[point.name], sight.dt_s)

    def _hints(self, point: PointFilter, anchor: Anchor | None) -> Hints:
        assert point.motion is not None
        depth_m = point.motion.position_m[2]
        noise_px = sigma_px(anchor, depth_m, self._info, self._config) if anchor else 1.0
        other = self._other(point)
        taken = self._ends.get(other.name) if other is not None else None
        return Hints(anchor, noise_px, other, self._ends.get(point.name), taken)

    def _other(self, point: PointFilter) -> PointFilter | None:
        for left, right in PAIRS:
            if point.name in (left, right):
                return self._points.get(right if point.name == left else left)
        return None

    def _calm(self, dt_s: float) -> None:
        """Let points that are hidden move as the head does, soon: arms do not fly off."""
        head = self._points.get(HEAD)
        if head is None or head.motion is None or head.state != "measured":
            return
        share = 1 - float(np.exp(-dt_s / CALM_S))
        for point in self._points.values():
            if point.motion is not None and point.state != "measured":
                point.motion.slow(head.motion.state[3:], share)

    def _begin(
        self, sight: Sight, body: Body3d, found: Mapping[str, Anchor], ends: Sequence[LimbEnd]
    ) -> None:
        """Start points that are not followed, and again those that their keypoints contradict."""
        for name, point in self._points.items():
            lost = point.motion is None or (self._combined and point.state == "lost")
            anchor = found.get(name)
            if anchor is None or anchor.confidence < SURE:
                continue
            if lost or point.contradicted > PATIENCE:
                self._start_near(name, anchor.pixel, body)
        if not (self._combined and self._config.keypoints and sight.keypoints is not None):
            points = self._points.values()
            idle = [point for point in points if self._is_idle(point)]
            for name, end in starts(points, idle, ends, body, self.facing):
                self._start(name, body.surface.nearest(end.position_m), body)

    def _is_idle(self, point: PointFilter) -> bool:
        """Tell whether a point waits for the end of a limb: it is lost, or on none for long."""
        if point.motion is None or not self._combined:
            return point.motion is None
        return not point.alive or point.unsupported_s > self._config.patience_s

    def _start_near(self, name: str, pixel: F64, body: Body3d) -> None:
        away = np.linalg.norm(body.surface.pixels_px - pixel, axis=1)
        vertex = int(np.argmin(away))
        if away[vertex] <= pixels_of(BEGIN_M, body.surface.points_m[vertex, 2], self._info):
            self._start(name, vertex, body)

    def _start(self, name: str, vertex: int, body: Body3d, *, marked: bool = False) -> None:
        point = self._points.get(name) or self._new(name)
        self._points[name] = point
        point.start(vertex, body, reference(point, vertex, body.surface, self._config))
        point.below_m = lengths_m(self._config).get(point.kind, np.nan)
        basin = body.tips.basin[vertex]
        if marked and basin >= 0:
            below = float(body.below_m[vertex])
            point.below_m = below if body.kinds[basin] == point.kind and below < 0.4 else np.nan
