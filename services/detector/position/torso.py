"""Where a person's torso is: the mean of both shoulders and both hips, also when some are hidden.

Motion capture and tracks mean this point. Depth is read in windows on the trunk, off its outline;
what is not in the person's own layer of depth (a wall, an arm stretched out, someone in front) does
not count. Each window tells where the axis is, their mean is the position.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F32, F64
from services.detector.models.base import InstanceMask
from services.detector.orientation.proportions import BOOL, ProportionRule, size_depth, torso_middle
from services.detector.position.certainty import (
    CertaintyRule,
    along_m2,
    axis_sigma,
    covariance,
    joint_m,
)
from services.detector.position.layers import (
    Layer,
    LayerRule,
    Places,
    disagreement,
    read_layer,
    settle,
)
from services.detector.position.position import TORSO, Place, Sight, read_depth
from services.detector.position.trunk import TrunkRule, surface_to_axis, turned

OTHERS = [i for i in range(17) if i not in TORSO]  # face and limbs
TRUNK_ROWS = (0.20, 0.275, 0.35, 0.425, 0.50)  # of a mask's height: chest to hips of who stands
WINDOW_MIN_PX = 5


class TorsoRule(msgspec.Struct, frozen=True, kw_only=True):
    """How the torso is read; all values are this project's."""

    pull: float = 0.3  # part of the way from a joint to the torso's middle: off the outline
    window_share: float = 0.12  # side of a window, of the torso's diagonal in the image
    window_max_px: int = 31  # [px] largest side of a window
    margin_share: float = 0.25  # a body's outline beyond its keypoints, of the torso's diagonal
    layer: LayerRule = LayerRule()  # what belongs to the person
    proportions: ProportionRule = ProportionRule()  # where hidden joints are
    # Where the trunk is hidden, face and limbs tell how far the axis is: so far behind them.
    beside_m: float = 0.06  # [m]
    beside_sigma_m: float = 0.1  # [m] its standard deviation

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 0 <= self.pull < 1:
            raise ValueError(f"pull: expected 0 to below 1, got {self.pull}")
        for name in ("window_share", "margin_share"):
            if not 0 < getattr(self, name) <= 1:
                raise ValueError(f"{name}: expected above 0 to 1, got {getattr(self, name)}")
        if not WINDOW_MIN_PX <= self.window_max_px <= 101:
            raise ValueError(
                f"window_max_px: expected {WINDOW_MIN_PX} to 101, got {self.window_max_px}"
            )
        if not (self.beside_m >= 0 and self.beside_sigma_m > 0):
            raise ValueError("beside_m, beside_sigma_m: expected >= 0 and > 0")


@dataclass(frozen=True, slots=True)
class Torso:
    """What one person's keypoints show."""

    joints_px: F64  # [px] 4x2, shoulders and hips
    known: BOOL  # 4, which of them are known
    trunk_px: F64  # [px] Nx2, where the depth of the trunk is read
    side_px: int  # [px] side of the windows
    places: Places  # the trunk's places, then others


class TorsoReader:
    """Reads where torsos are.

    Args:
        rule: How.
        trunk: Moves positions from the surface to the axis; None: they stay on the surface.
        certainty: How sure readings, bodies and joints are.
    """

    def __init__(self, rule: TorsoRule, trunk: TrunkRule | None, certainty: CertaintyRule) -> None:
        self._rule = rule
        self._trunk = trunk
        self._certainty = certainty

    def people(
        self, keypoints: Sequence[F32], confidence_min: float, sights: Sequence[Sight]
    ) -> list[Place | None]:
        """Return where the torsos of all people in a frame are, by their joints.

        Args:
            keypoints: 17x3 each, u and v in pixels and confidence, COCO order.
            confidence_min: Joints must be more confident than this, 0 to 1.
            sights: What the camera sees, and which way each person faces.

        Returns:
            None where no joint is confident and inside the image, where depth has nothing there,
            or only somebody in front.
        """
        torsos = self.settled(keypoints, confidence_min, sights)
        return [
            None if torso is None else self.place(*torso, sight)
            for torso, sight in zip(torsos, sights, strict=True)
        ]

    def settled(
        self, keypoints: Sequence[F32], confidence_min: float, sights: Sequence[Sight]
    ) -> list[tuple[Torso, Layer] | None]:
        """Return what the keypoints of all people in a frame show, and each one's layer of depth.

        Which way people face does not matter. Arguments and None are those of `people`.
        """
        torsos = [
            self._look(points, confidence_min, sight)
            for points, sight in zip(keypoints, sights, strict=True)
        ]
        layers = iter(settle([t.places for t in torsos if t is not None], self._rule.layer))
        found = [None if torso is None else (torso, next(layers)) for torso in torsos]
        return [None if f is None or f[1] is None else (f[0], f[1]) for f in found]

    def _look(self, keypoints: F32, confidence_min: float, sight: Sight) -> Torso | None:
        """Return what one person's keypoints show; None if no joint is known."""
        info, rule = sight.info, self._rule
        joints_px = keypoints[TORSO, :2].astype(np.float64)
        known = keypoints[TORSO, 2] > confidence_min
        edge = (info.width - 0.5, info.height - 0.5)
        known &= ((joints_px > -0.5) & (joints_px < edge)).all(axis=1)
        if not known.any():
            return None
        middle_px = joints_px[known].mean(axis=0)
        trunk_px = joints_px[known] + (middle_px - joints_px[known]) * rule.pull
        trunk_px = np.vstack([trunk_px, middle_px])
        diagonal_px = float(np.linalg.norm(np.ptp(joints_px[known], axis=0)))
        side_px = self._side(diagonal_px)
        others_px = keypoints[OTHERS, :2][keypoints[OTHERS, 2] > confidence_min].astype(np.float64)
        common_m = size_depth(joints_px, known, info, rule.proportions)
        places = replace(
            self._places(trunk_px, others_px, side_px, sight),
            common_m=common_m,
            margin_px=rule.margin_share * diagonal_px,
        )
        return Torso(joints_px, known, trunk_px, side_px, places)

    def place(self, torso: Torso, layer: Layer, sight: Sight) -> Place:
        """Return the place of a torso whose layer is known."""
        joints_m = deproject(torso.joints_px, np.full(4, layer.depth_m), sight.info)[:, :2]
        sigma_m = joint_m(layer.depth_m, sight.info, self._certainty)
        middle_m, across_m2 = torso_middle(
            joints_m, torso.known, sight.yaw_rad, sigma_m, self._rule.proportions
        )
        own_px = torso.trunk_px[layer.own[: len(torso.trunk_px)]]
        middle_m = np.array([*middle_m, layer.depth_m])
        doubt_m2 = disagreement(torso.places, layer, self._rule.layer.half_m)
        return self._place(middle_m, (across_m2, doubt_m2), own_px, torso.side_px, sight)

    def mask(self, mask: InstanceMask, sight: Sight) -> Place | None:
        """Return where the torso is by the upper middle of a mask.

        Returns:
            None if depth has nothing there.
        """
        rows = np.flatnonzero(mask.window.any(axis=1))
        if not len(rows):
            return None
        height = rows[-1] - rows[0] + 1
        chosen = rows[np.searchsorted(rows, rows[0] + np.array(TRUNK_ROWS) * (height - 1))]
        columns = [float(np.flatnonzero(mask.window[row]).mean()) for row in chosen]
        trunk_px = np.column_stack([mask.x_px + np.array(columns), mask.y_px + chosen])
        side_px = self._side(height * float(np.ptp(TRUNK_ROWS)))
        layer = settle([self._places(trunk_px, trunk_px[:0], side_px, sight)], self._rule.layer)[0]
        if layer is None:
            return None
        layer_m = layer.depth_m
        middle_m = deproject(trunk_px.mean(axis=0), [layer_m], sight.info)[0]
        rule = self._certainty
        across_m2 = rule.centroid_m**2 + (rule.joint_px * layer_m / sight.info.fx) ** 2
        return self._place(middle_m, (across_m2, 0.0), trunk_px, side_px, sight)

    def _side(self, torso_px: float) -> int:
        """Return the odd side of windows on a torso of a size in the image."""
        side_px = round(self._rule.window_share * torso_px)
        return min(max(side_px, WINDOW_MIN_PX), self._rule.window_max_px) | 1

    def _places(self, trunk_px: F64, others_px: F64, side_px: int, sight: Sight) -> Places:
        """Read depth for the first time, at places on the trunk and, after them, at others."""
        pixels = np.vstack([trunk_px, others_px])
        weights = np.repeat([1.0, self._rule.layer.other_weight], [len(trunk_px), len(others_px)])
        depth_m = read_depth(pixels, sight.depth_mm, sight.info.max_depth_m, side_px)
        return Places(pixels, depth_m, weights)

    def _place(
        self,
        middle_m: F64,
        unsure_m2: tuple[float, float],
        trunk_px: F64,
        side_px: int,
        sight: Sight,
    ) -> Place:
        """Return the place of a torso whose middle is known but for its exact depth.

        Args:
            middle_m: 3, at the depth of the person's layer.
            unsure_m2: Variance across the line of sight, and along it that of the layer.
            trunk_px: Nx2, where the trunk's depth is read.
            side_px: Side of the windows.
            sight: What the camera sees.
        """
        rule, layer_m = self._rule, float(middle_m[2])
        read = np.zeros(len(trunk_px), np.bool_)
        if len(trunk_px):
            depth_m = read_layer(trunk_px, side_px, sight.depth_mm, layer_m, rule.layer.half_m)
            read = np.isfinite(depth_m)
        if read.any():
            right_m = deproject(trunk_px, np.full(len(read), layer_m), sight.info)[read, 0]
            axis_m = depth_m[read] + self._behind(right_m - middle_m[0], middle_m, sight)
            unsure_m = axis_sigma(self._trunk, sight.yaw_rad, self._certainty)
        else:
            axis_m = np.array([layer_m + (rule.beside_m if self._trunk else 0.0)])
            unsure_m = rule.beside_sigma_m
        position_m = middle_m * (axis_m.mean() / layer_m)
        across_m2, doubt_m2 = unsure_m2
        along = along_m2(layer_m, axis_m, unsure_m, self._certainty) + doubt_m2
        return Place(position_m, covariance(position_m, across_m2, across_m2, along))

    def _behind(self, right_m: F64, middle_m: F64, sight: Sight) -> F64:
        """Return how far the axis lies behind places of the surface, along the optical axis."""
        if self._trunk is None:
            return np.zeros(len(right_m))
        cosine = middle_m[2] / math.hypot(middle_m[0], middle_m[2])
        turned_rad = turned(middle_m, sight.yaw_rad)
        behind: F64 = surface_to_axis(right_m * cosine, turned_rad, self._trunk) * cosine
        return behind
