"""The points of a body that are followed, and where a detector's keypoints put them."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from common.geometry.transforms import deproject, project
from people4d.messages import F32, F64, CameraInfo
from services.gait.points.config import DepthLayerConfig

HEAD, LEFT_HAND, RIGHT_HAND = "head", "left_hand", "right_hand"
LEFT_FOOT, RIGHT_FOOT = "left_foot", "right_foot"
POINTS = (HEAD, LEFT_HAND, RIGHT_HAND, LEFT_FOOT, RIGHT_FOOT)
PAIRS = ((LEFT_HAND, RIGHT_HAND), (LEFT_FOOT, RIGHT_FOOT))

FACE = slice(0, 5)  # COCO: nose, eyes, ears
TORSO = [5, 6, 11, 12]  # COCO: shoulders and hips
# COCO: the joint at a limb's far end, and the one before it.
JOINTS: Mapping[str, tuple[int, int]] = MappingProxyType(
    {LEFT_HAND: (9, 7), RIGHT_HAND: (10, 8), LEFT_FOOT: (15, 13), RIGHT_FOOT: (16, 14)}
)
SURE = 0.5  # confidence of a keypoint or of an end of a limb at which a lost point starts
BENT = 1.5  # times the noise, where the direction of a limb is not known
# Times the noise: the face is beside the head's middle; where a foot points is not known at first.
LOOSE: Mapping[str, float] = MappingProxyType({"head": 2.0, "hand": 1.0, "foot": 2.5})


@dataclass(frozen=True)
class Anchor:
    """Where keypoints put a point."""

    pixel: F64  # [px] 2: u, v
    sigma: float  # noise, as a share of what a sure keypoint has
    confidence: float  # 0 to 1


def kind_of(point: str) -> str:
    """Return what a point is the end of: head, hand or foot; empty of a marked point."""
    return point.rpartition("_")[2] if point in POINTS else ""


def anchors(keypoints: F32 | None, config: DepthLayerConfig) -> Mapping[str, Anchor]:
    """Return where keypoints put the points of a body.

    A wrist is not the hand, nor an ankle the foot: both are gone beyond, by a share of forearm and
    shank as they are seen.

    Args:
        keypoints: 17x3, u and v in pixels and confidence, COCO order; None: there are none.
        config: What is sure enough, and the shares.

    Returns:
        By the names of points; those that keypoints do not tell are absent.
    """
    if keypoints is None or keypoints.shape != (17, 3):
        return {}
    uv, sure = keypoints[:, :2].astype(np.float64), keypoints[:, 2].astype(np.float64)
    sure = np.where(np.isfinite(keypoints).all(axis=1), sure, 0.0)
    least = config.keypoint_confidence_min
    found = {}
    face = np.flatnonzero(sure[FACE] > least)
    if len(face):
        found[HEAD] = Anchor(uv[face].mean(axis=0), LOOSE["head"], float(sure[face].max()))
    for point, (end, before) in JOINTS.items():
        if sure[end] <= least:
            continue
        reach = config.hand_reach if kind_of(point) == "hand" else config.foot_reach
        known = sure[before] > least
        pixel = uv[end] + reach * (uv[end] - uv[before]) if known else uv[end]
        sigma = LOOSE[kind_of(point)] * (1.0 if known else BENT)
        found[point] = Anchor(pixel, sigma, float(sure[end]))
    return found


def stepped(
    found: Mapping[str, Anchor],
    depth_m: float,
    facing: F64,
    info: CameraInfo,
    config: DepthLayerConfig,
) -> Mapping[str, Anchor]:
    """Return anchors with those of feet moved ahead of their ankles.

    Args:
        found: Anchors.
        depth_m: Of the body.
        facing: 3, unit length, optical frame: the way the person faces, as feet do.
        info: Calibration.
        config: How far.
    """
    moved = dict(found)
    for name, anchor in found.items():
        if kind_of(name) == "foot":
            place = deproject(anchor.pixel, [depth_m], info)[0] + config.foot_ahead_m * facing
            pixel = project(place, info)[0]
            moved[name] = Anchor(pixel, anchor.sigma / LOOSE["foot"], anchor.confidence)
    return moved


def torso_pixel(keypoints: F32 | None, config: DepthLayerConfig) -> F64 | None:
    """Return the middle of the shoulders and hips in the image; None if keypoints do not tell."""
    if keypoints is None or keypoints.shape != (17, 3):
        return None
    torso = keypoints[TORSO].astype(np.float64)
    sure = np.isfinite(torso).all(axis=1) & (torso[:, 2] > config.keypoint_confidence_min)
    middle: F64 | None = torso[:, :2].mean(axis=0) if sure.all() else None
    return middle
