"""The depth layer: points of one person's body followed in depth (method book section 8.3)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from common.geometry import deproject, project
from common.messages import F32, F64, CameraInfo
from services.gait.depth_config import DepthLayerConfig
from services.gait.facing import Facing
from services.gait.floor import Floor
from services.gait.geodesic import geodesic_m
from services.gait.limbs import UP, Body3d, LimbEnd, body_of, heights_of, lengths_m, limb_ends
from services.gait.matching import ALONG_SIGMA_M, match
from services.gait.point_filter import PointEstimate, PointFilter, Proposal
from services.gait.points import PAIRS, Anchor, anchors, stepped
from services.gait.spin_image import similarity, spin_images
from services.gait.surface import I64, Surface
from services.gait.tips import tips_of
from services.gait.trunk import Trunk
from services.gait.weighing import Hints, Weighed, agreement, alone, together

__all__ = ["DepthLayer", "PointEstimate", "Sight"]

MIN_VERTICES = 30  # fewer are no body
SURE = 0.5  # of a keypoint or an end of a limb from which a lost point starts
APART = 3.0  # [standard deviations] of a point and its keypoint, which then disagree
PATIENCE = 2  # frames of disagreement
ARM = 0.3  # of the stature, from the trunk's middle to the fingertips, at least
CROSSING_M = 0.12  # [m] between left and right, nearer than which they may be taken for each other


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
        self._disagreed = dict.fromkeys(config.points, 0)
        self._votes: dict[str, float] = {}
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
        self._disagreed.pop(name, None)

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
        ends = limb_ends(body, self._config) if self._combined or not self._begun() else []
        self._move(sight, found, ends)
        self._weigh(sight, body, found)
        self._begin(sight, body, found, ends)
        if not found and self._combined:
            self._check_sides(sight)
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
            proposals = self._proposals(point, found.get(name)) if self._combined else []
            point.propagate(sight.dt_s, proposals)

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

    def _proposals(self, point: PointFilter, anchor: Anchor | None) -> list[Proposal]:
        """Return where else a point may be: at its keypoint, at the end of its limb."""
        assert point.motion is not None
        share = self._config.proposed
        ahead = project(point.motion.position_m, self._info)[0]
        spread = self._pixels(min(point.motion.spread_m, 0.15), point.motion.position_m[2])
        proposals = [Proposal(ahead, spread, share / 2)]
        if anchor is not None:
            sigma = self._anchor_sigma(point.motion.position_m[2], anchor)
            proposals.append(Proposal(anchor.pixel, sigma, share / 2))
        end = self._ends.get(point.name)
        if end is not None:
            sigma = self._pixels(0.03, end.position_m[2])
            pixel = project(end.position_m, self._info)[0]
            proposals.append(Proposal(pixel, sigma, share / 2))
        return proposals

    def _weigh(self, sight: Sight, body: Body3d, found: Mapping[str, Anchor]) -> None:
        """Weigh the particles of all points, and take in what they tell."""
        points = [point for point in self._points.values() if point.motion is not None]
        for point in points:
            point.settle(body)
        alike = self._alike(points, body)
        weighed = [
            self._weighed(point, body, like, found.get(point.name))
            for point, like in zip(points, alike, strict=True)
        ]
        for point, result in zip(points, weighed, strict=True):
            self.trust[point.name] = result.trust
            self._take(point, body, result, found.get(point.name), sight.dt_s)

    def _alike(self, points: Sequence[PointFilter], body: Body3d) -> list[F64]:
        """Return how like the reference the spin images of all particles are."""
        if self._config.feature == "geodesic":
            return [np.zeros(len(point.vertices)) for point in points]
        vertices: list[I64] = [point.vertices for point in points]
        distinct, inverse = np.unique(np.concatenate([[-1], *vertices]), return_inverse=True)
        images = spin_images(body.surface, distinct, self._config.spin)
        found, at = [], 1
        for point in points:
            mine = inverse[at : at + len(point.vertices)]
            at += len(mine)
            rows, back = np.unique(mine, return_inverse=True)
            assert point.spin is not None
            found.append(similarity(images[rows], point.spin)[back])
        return found

    def _weighed(
        self, point: PointFilter, body: Body3d, alike: F64, anchor: Anchor | None
    ) -> Weighed:
        if not self._combined:
            return alone(point, body, alike, self._config)
        assert point.motion is not None
        sigma = self._anchor_sigma(point.motion.position_m[2], anchor) if anchor else 1.0
        other = self._other(point)
        taken = self._ends.get(other.name) if other is not None else None
        hints = Hints(anchor, sigma, other, self._ends.get(point.name), taken)
        return together(point, body, alike, hints, self._config)

    def _other(self, point: PointFilter) -> PointFilter | None:
        for left, right in PAIRS:
            if point.name in (left, right):
                return self._points.get(right if point.name == left else left)
        return None

    def _take(
        self, point: PointFilter, body: Body3d, result: Weighed, anchor: Anchor | None, dt_s: float
    ) -> None:
        logs = result.logs
        best = int(np.argmax(logs))
        if not np.isfinite(logs[best]):
            point.missed(dt_s)
            point.scatter(body)
            return
        weights = np.exp(logs - logs[best])
        weights /= weights.sum()
        places = body.surface.points_m[np.maximum(point.vertices, 0)]
        if self._combined:
            near = np.linalg.norm(places - places[best], axis=1) <= self._config.window_m
            kept = weights * near * (point.vertices >= 0)
            position = (kept / kept.sum()) @ places
            self._judge(point, body, position, best, anchor, dt_s)
        else:
            point.measured(places[best], 1.0)
        point.resample(weights)

    def _judge(
        self,
        point: PointFilter,
        body: Body3d,
        position: F64,
        best: int,
        anchor: Anchor | None,
        dt_s: float,
    ) -> None:
        """Take a position in if enough speaks for it."""
        assert point.motion is not None
        config = self._config
        noise = point.noise_m2(position)
        off = float(np.sqrt(point.motion.distances2(position[None], noise)[0]))
        support = self._by_limb(point, body, point.vertices[best])
        if anchor is not None:
            support = max(support, self._by_anchor(point, position, anchor))
        point.unsupported_s = 0.0 if support > config.confidence_min else point.unsupported_s + dt_s
        # Neither limb nor keypoint: what is alike elsewhere is believed for a while only.
        waned = float(np.exp(-point.unsupported_s / (2 * config.patience_s))) if point.kind else 1.0
        support = max(support, waned * self._by_distance(point, body, point.vertices[best]))
        confidence = support * float(agreement(np.array(off / config.gate * 1.5)))
        if off > config.gate or confidence < config.confidence_min or point.state == "lost":
            point.missed(dt_s)
            return
        point.measured(position, confidence)
        vertex = point.vertices[best]
        if confidence > SURE:
            point.adapt(float(body.along_m[vertex]))

    def _by_limb(self, point: PointFilter, body: Body3d, vertex: int) -> float:
        """Return how well a vertex fits the end of the point's limb, 0 to 1."""
        end = self._ends.get(point.name)
        if end is None or body.tips.basin[vertex] != end.basin or not np.isfinite(point.below_m):
            return 0.0
        off = (body.below_m[vertex] - point.below_m) / self._config.tip_sigma_m
        return end.strength * float(agreement(np.array(off / 1.5)))

    def _by_distance(self, point: PointFilter, body: Body3d, vertex: int) -> float:
        """Return how well a vertex fits the point's distance along the body, 0 to 1."""
        off = (body.along_m[vertex] - point.along_m) / self._config.geodesic_sigma_m
        return float(agreement(np.array(np.nan_to_num(off, nan=9.0, posinf=9.0) / 1.5)))

    def _by_anchor(self, point: PointFilter, position: F64, anchor: Anchor) -> float:
        """Return how well a position fits the point's keypoint, 0 to 1."""
        pixel = project(position, self._info)[0]
        apart = float(np.linalg.norm(pixel - anchor.pixel))
        apart /= self._anchor_sigma(position[2], anchor)
        count = self._disagreed.get(point.name, 0) + 1
        wrong = apart > APART and anchor.confidence > SURE
        self._disagreed[point.name] = count if wrong else 0
        sure = float(np.clip((anchor.confidence - 0.4) / 0.3, 0.0, 1.0))
        return sure * float(agreement(np.array(apart / 1.5)))

    def _begin(
        self, sight: Sight, body: Body3d, found: Mapping[str, Anchor], ends: Sequence[LimbEnd]
    ) -> None:
        """Start points that are not followed, and again those that their keypoints contradict."""
        for name, point in self._points.items():
            contradicted = self._disagreed.get(name, 0) > PATIENCE
            idle = point.motion is None or (self._combined and point.state == "lost")
            anchor = found.get(name)
            if not (idle or contradicted) or (anchor is not None and anchor.confidence < SURE):
                continue
            if anchor is not None:
                self._start_near(name, anchor.pixel, body, 0.05)
        if not (self._combined and self._config.keypoints and sight.keypoints is not None):
            self._begin_at_ends(sight, body, ends)

    def _start_near(self, name: str, pixel: F64, body: Body3d, reach_m: float) -> None:
        away = np.linalg.norm(body.surface.pixels_px - pixel, axis=1)
        vertex = int(np.argmin(away))
        if away[vertex] <= self._pixels(reach_m, body.surface.points_m[vertex, 2]):
            self._start(name, vertex, body)

    def _begin_at_ends(self, sight: Sight, body: Body3d, ends: Sequence[LimbEnd]) -> None:
        """Start points at the ends of limbs; which is left tells the way the person faces."""
        forward = np.array([0.0, 0.0, -1.0]) if self.facing is None else self.facing
        left = np.cross(UP, forward)
        for kind in ("head", "hand", "foot"):
            points = [point for point in self._points.values() if point.kind == kind]
            idle = [point for point in points if self._is_idle(point)]
            taken = [
                point.motion.position_m
                for point in points
                if point not in idle and point.motion is not None
            ]
            free = [
                end
                for end in ends
                if end.kind == kind
                and end.strength > SURE
                and (kind != "hand" or end.along_m > ARM * self._stature_m)
                and all(np.linalg.norm(end.position_m - place) > 0.12 for place in taken)
            ]
            self._assign(idle, free[: len(idle)], left, body)

    def _is_idle(self, point: PointFilter) -> bool:
        """Tell whether a point waits for the end of a limb: it is lost, or on none for long."""
        if point.motion is None or not self._combined:
            return point.motion is None
        return not point.alive or point.unsupported_s > self._config.patience_s

    def _check_sides(self, sight: Sight) -> None:
        """Exchange left and right that contradict the way the person walks for long."""
        if self.facing is None:
            return
        side = np.cross(UP, self.facing)
        for left, right in PAIRS:
            pair = [self._points.get(left), self._points.get(right)]
            if not all(p and p.state == "measured" for p in pair):
                continue
            a, b = (p.motion.position_m for p in pair if p and p.motion)
            apart = float((a - b) @ side)
            votes = self._votes.get(left, 0.0)
            votes += sight.dt_s * (1.0 if apart < -CROSSING_M / 2 else -1.0)
            self._votes[left] = max(votes, 0.0)
            if votes > 2 * self._config.swap_s:
                self._votes[left] = 0.0
                self._exchange(left, right)

    def _assign(
        self, idle: Sequence[PointFilter], ends: Sequence[LimbEnd], left: F64, body: Body3d
    ) -> None:
        """Start points of one kind at ends of limbs, left ones on the left."""
        middle = np.median(body.surface.points_m, axis=0)
        for end in sorted(ends, key=lambda end: -abs(float((end.position_m - middle) @ left))):
            likely = [point for point in idle if self._fits(point, end)]
            side = "left" if float((end.position_m - middle) @ left) > 0 else "right"
            # Of two that wait the one of that side; one that waits alone is the other one's pair.
            chosen = [point for point in likely if point.name.startswith(side) or len(idle) == 1]
            chosen = chosen or [point for point in likely if point.kind == "head"]
            if chosen:
                self._start(chosen[0].name, body.surface.nearest(end.position_m), body)
                idle = [point for point in idle if point is not chosen[0]]

    def _fits(self, point: PointFilter, end: LimbEnd) -> bool:
        """Tell whether a limb is as long as it was; a point keeps that while it is lost."""
        length = point.along_m + np.nan_to_num(point.below_m)
        return bool(np.isnan(length) or abs(end.along_m - length) < 2.5 * ALONG_SIGMA_M)

    def _start(self, name: str, vertex: int, body: Body3d, *, marked: bool = False) -> None:
        point = self._points.get(name) or self._new(name)
        self._points[name] = point
        self._disagreed[name] = 0
        point.start(vertex, body, spin_images(body.surface, [vertex], self._config.spin)[0])
        point.below_m = lengths_m(self._config).get(point.kind, np.nan)
        basin = body.tips.basin[vertex]
        if marked and basin >= 0:
            below = float(body.below_m[vertex])
            point.below_m = below if body.kinds[basin] == point.kind and below < 0.4 else np.nan

    def _pixels(self, length_m: float, depth_m: float) -> float:
        return float(self._info.fx * length_m / max(depth_m, 0.1))

    def _anchor_sigma(self, depth_m: float, anchor: Anchor) -> float:
        return anchor.sigma * self._pixels(self._config.keypoint_sigma_m, depth_m)
