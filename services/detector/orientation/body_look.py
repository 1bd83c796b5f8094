"""What one frame shows of a body that tells which way it faces.

Everything is measured from the line of sight to the torso: across it to the right, and along it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import msgspec
import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F32, F64
from services.detector.position.position import Sight

NOSE, LEFT_EAR, RIGHT_EAR = 0, 3, 4  # COCO
LEFT_SHOULDER, RIGHT_SHOULDER, LEFT_HIP, RIGHT_HIP = 5, 6, 11, 12
FACE = [0, 1, 2, 3, 4]
SIDES = [[1, 3, 5, 7, 9, 11, 13, 15], [2, 4, 6, 8, 10, 12, 14, 16]]  # left, right
WINDOW_MIN_PX = 5
SEEN_MIN = 0.2  # of a joint's window that shows the person's own layer: else others hide the joint


def expect_positive(record: msgspec.Struct, *names: str) -> None:
    """Check that fields are above 0 and finite."""
    for name in names:
        if not 0 < getattr(record, name) < math.inf:
            raise ValueError(f"{name}: expected a number > 0, got {getattr(record, name)}")


class PairRule(msgspec.Struct, frozen=True, kw_only=True):
    """How the shoulders or the hips look."""

    width_m: float  # [m] between both, as a network marks them
    # [m] in profile the nearer one is marked so much ahead of the farther one
    ahead_m: float
    gain_front: float  # difference in depth of the surface over that of the joints, from the front
    gain_back: float  # likewise, from behind
    window_m: float  # [m] side of the window whose median is a joint's depth
    sigma_across_m: float = 0.04  # [m] standard deviation of the distance across the line of sight
    sigma_along_m: float  # [m] of the difference in depth

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in self.__struct_fields__:
            expect_positive(self, name)


# Shoulder joints are about 0.19 of stature apart, hips are marked on the outside of their joints,
# which are 0.1 apart. Fitted to films of the simulated room, with all that is here.
SHOULDERS = PairRule(
    width_m=0.32,
    ahead_m=0.01,
    gain_front=0.87,
    gain_back=0.63,
    window_m=0.1,
    sigma_along_m=0.04,
)
HIPS = PairRule(
    width_m=0.21,
    ahead_m=0.04,
    gain_front=0.83,
    gain_back=0.67,
    window_m=0.2,
    sigma_along_m=0.035,
)


@dataclass(frozen=True, slots=True)
class Pair:
    """Where the right joint of a pair is, from the left one; NaN where that is not known."""

    across_m: float  # [m] to the right
    along_m: float  # [m] farther from the camera


@dataclass(frozen=True, slots=True)
class Look:
    """What is seen of one person."""

    z_m: float  # [m] depth of the person
    pairs: Mapping[str, Pair]  # "shoulders" and "hips"
    nose_m: float  # [m] nose to the left of the ears' middle; NaN: not known
    ears_m: float  # [m] right ear to the right of the left one; NaN: not known
    face: float = math.nan  # mean confidence of nose, eyes and ears
    side: float = math.nan  # mean confidence of the keypoints of the side that is less sure


class Viewer:
    """Measures how bodies look.

    Args:
        pairs: How the pairs are read, "shoulders" and "hips".
        confidence_min: Keypoints must be more confident than this, 0 to 1.
        reach_m: Readings of depth farther from the person's layer do not count.
    """

    JOINTS = {  # noqa: RUF012
        "shoulders": (LEFT_SHOULDER, RIGHT_SHOULDER),
        "hips": (LEFT_HIP, RIGHT_HIP),
    }

    def __init__(
        self, pairs: Mapping[str, PairRule], confidence_min: float, reach_m: float
    ) -> None:
        self._pairs = pairs
        self._confidence_min = confidence_min
        self._reach_m = reach_m

    def look(self, keypoints: F32, layer_m: float, ray_rad: float, sight: Sight) -> Look:
        """Measure how a person looks.

        Args:
            keypoints: 17x3, u and v in pixels and confidence, COCO order.
            layer_m: Depth of the layer that the person is in.
            ray_rad: Direction of the line of sight, 0 = optical axis, + to the left.
            sight: What the camera sees.
        """
        pixels = keypoints[:, :2].astype(np.float64)
        pixels[keypoints[:, 2] <= self._confidence_min] = np.nan
        across_m = deproject(pixels, np.full(17, layer_m), sight.info)[:, 0] * math.cos(ray_rad)
        pairs = {}
        for name, joints in self.JOINTS.items():
            left, right = joints
            depth_m = [self._depth(pixels[joint], name, layer_m, sight) for joint in joints]
            wide_m, deep_m = across_m[right] - across_m[left], depth_m[1] - depth_m[0]
            if math.isnan(deep_m):
                wide_m = math.nan  # where a joint is that others hide is a guess
            pairs[name] = Pair(wide_m, deep_m / math.cos(ray_rad) - wide_m * math.tan(ray_rad))
        ears_m, confidence = across_m[[LEFT_EAR, RIGHT_EAR]], keypoints[:, 2].astype(np.float64)
        return Look(
            z_m=layer_m,
            pairs=pairs,
            nose_m=float(ears_m.mean() - across_m[NOSE]),
            ears_m=float(ears_m[1] - ears_m[0]),
            face=float(confidence[FACE].mean()),
            side=min(float(confidence[side].mean()) for side in SIDES),
        )

    def _depth(self, pixel: F64, name: str, layer_m: float, sight: Sight) -> float:
        """Return the depth in the window of a joint, NaN where the person is hardly seen there."""
        height, width = sight.depth_mm.shape
        if not ((pixel > -0.5) & (pixel < (width - 0.5, height - 0.5))).all():
            return math.nan  # NaN pixels too
        half_px = self._pairs[name].window_m / 2 * sight.info.fx / layer_m
        reach = max(round(half_px), WINDOW_MIN_PX // 2)
        u, v = np.rint(pixel).astype(int).tolist()
        rows = slice(max(v - reach, 0), v + reach + 1)
        window_m = sight.depth_mm[rows, max(u - reach, 0) : u + reach + 1] / 1000.0
        own_m = window_m[np.abs(window_m - layer_m) <= self._reach_m]
        return float(np.median(own_m)) if own_m.size >= SEEN_MIN * window_m.size else math.nan
