"""Names of the tracked points, and their expected pixels by the detector's keypoints."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from common.geometry.transforms import deproject, project
from people4d.messages import F32, F64, CameraInfo

HEAD, LEFT_HAND, RIGHT_HAND = "head", "left_hand", "right_hand"
LEFT_FOOT, RIGHT_FOOT = "left_foot", "right_foot"
POINTS = (HEAD, LEFT_HAND, RIGHT_HAND, LEFT_FOOT, RIGHT_FOOT)
KINDS = ("head", "hand", "foot")
PAIRS = ((LEFT_HAND, RIGHT_HAND), (LEFT_FOOT, RIGHT_FOOT))
COUNTERPARTS = {a: b for pair in PAIRS for a, b in (pair, pair[::-1])}

FACE = slice(0, 5)  # COCO: nose, eyes, ears
TORSO = [5, 6, 11, 12]  # COCO: shoulders and hips
ANKLES = [15, 16]  # COCO
# COCO indices of the joint at a limb's end, and of the joint before it
JOINTS: Mapping[str, tuple[int, int]] = MappingProxyType(
    {LEFT_HAND: (9, 7), RIGHT_HAND: (10, 8), LEFT_FOOT: (15, 13), RIGHT_FOOT: (16, 14)}
)
KEYPOINT_SIGMA_M = 0.04  # Standard deviation of a keypoint, at right angles to the ray [m]
KEYPOINT_CONFIDENCE_MIN = 0.4  # Minimum confidence of a keypoint
ANKLE_CONFIDENCE_MIN = 0.1  # Minimum confidence of the keypoint of an ankle near its foot
START_CONFIDENCE = 0.5  # Minimum confidence of a keypoint or extremity that starts a lost point
HAND_REACH = 0.5  # Offset from the wrist to the middle of the hand [forearms]
# Minimum mean confidence of ankles of trusted keypoints: 0.23 to 0.40 of real people whose steps
# keypoints lose, 0.49 to 0.71 of simulated people whose steps they find
TRUST_MIN = 0.45
TRUST_FRAMES = 50  # Number of frames in the mean
FOOT_REACH = 0.12  # Offset from the ankle to the middle of the foot [shanks]
FOOT_AHEAD_M = 0.07  # Offset from the ankle ahead to the middle of the foot [m]
UNDIRECTED_NOISE = 1.5  # Factor of the noise without the direction of the limb
# Factor of the noise: the face is off the head's middle; the direction of a foot is unknown
KIND_NOISE: Mapping[str, float] = MappingProxyType({"head": 2.0, "hand": 1.0, "foot": 2.5})


@dataclass(frozen=True)
class Anchor:
    """Expected pixel of a point by keypoints."""

    pixel: F64  # [px] 2: u, v
    sigma: float  # noise, relative to the noise of a keypoint
    confidence: float  # 0 to 1
    joint: F64 | None = None  # [px] 2: pixel of the keypoint, for hands and feet
    before: F64 | None = None  # [px] 2: pixel of the elbow or knee, if known


class KeypointTrust:
    """Trust in the keypoints of a person, by the mean confidence of the ankles.

    Uncertain ankles are often on the other leg, on another person or absent. Ends of limbs in the
    depth image show more steps of such people.
    """

    def __init__(self) -> None:
        self._frames, self._confidence = 0, 0.0

    def update(self, keypoints: F32 | None) -> bool:
        """Add a frame and return True if keypoints are trusted; None: not detected."""
        if keypoints is not None and keypoints.shape == (17, 3):
            confidence = float(np.nan_to_num(keypoints[ANKLES, 2]).mean())
            self._frames = min(self._frames + 1, TRUST_FRAMES)
            self._confidence += (confidence - self._confidence) / self._frames
        return self._confidence > TRUST_MIN


def kind_of(point: str) -> str:
    """Return the kind of a point: head, hand or foot."""
    return point.rpartition("_")[2]


def pixels_of(length_m: float, depth_m: float, info: CameraInfo) -> float:
    """Return a length at a depth in pixels."""
    return float(info.fx * length_m / max(depth_m, 0.1))


def sigma_px(anchor: Anchor, depth_m: float, info: CameraInfo) -> float:
    """Return the noise of an anchor in pixels."""
    return anchor.sigma * pixels_of(KEYPOINT_SIGMA_M, depth_m, info)


def find_anchors(keypoints: F32 | None) -> Mapping[str, Anchor]:
    """Return the expected pixels of points by confident keypoints (17x3, COCO; None: not detected).

    Hands are beyond the wrists and feet beyond the ankles, by a ratio of forearm and shank in the
    image. Ankles of low confidence count, too: most are correct, and the body is decisive.
    """
    if keypoints is None or keypoints.shape != (17, 3):
        return {}
    uv, confidence = keypoints[:, :2].astype(np.float64), keypoints[:, 2].astype(np.float64)
    confidence = np.where(np.isfinite(keypoints).all(axis=1), confidence, 0.0)
    found = {}
    face = np.flatnonzero(confidence[FACE] > KEYPOINT_CONFIDENCE_MIN)
    if len(face):
        middle = uv[face].mean(axis=0)
        found[HEAD] = Anchor(middle, KIND_NOISE["head"], float(confidence[face].max()))
    for point, (end, before) in JOINTS.items():
        foot = kind_of(point) == "foot"
        if confidence[end] <= (ANKLE_CONFIDENCE_MIN if foot else KEYPOINT_CONFIDENCE_MIN):
            continue
        reach = FOOT_REACH if foot else HAND_REACH
        directed = confidence[before] > KEYPOINT_CONFIDENCE_MIN
        pixel = uv[end] + reach * (uv[end] - uv[before]) if directed else uv[end]
        sigma = KIND_NOISE[kind_of(point)] * (1.0 if directed else UNDIRECTED_NOISE)
        known = uv[before] if directed else None
        found[point] = Anchor(pixel, sigma, float(confidence[end]), uv[end], known)
    return found


def feet_ahead(
    found: Mapping[str, Anchor],
    depth_m: float,
    heading: F64,
    info: CameraInfo,
) -> Mapping[str, Anchor]:
    """Return anchors with feet moved ahead of their ankles.

    Feet have the heading of the person, a unit vector in the optical frame.
    """
    moved = dict(found)
    for name, anchor in found.items():
        if kind_of(name) == "foot":
            ankle_m = deproject(anchor.pixel, [depth_m], info)[0]
            pixel = project(ankle_m + FOOT_AHEAD_M * heading, info)[0]
            moved[name] = replace(anchor, pixel=pixel, sigma=anchor.sigma / KIND_NOISE["foot"])
    return moved


def joint_pixels(keypoints: F32 | None) -> Mapping[str, F64]:
    """Return the pixels of elbows and knees, by the names of their hands and feet."""
    if keypoints is None or keypoints.shape != (17, 3):
        return {}
    rows = {name: keypoints[before].astype(np.float64) for name, (_, before) in JOINTS.items()}
    return {
        name: row[:2]
        for name, row in rows.items()
        if np.isfinite(row).all() and row[2] > KEYPOINT_CONFIDENCE_MIN
    }


def torso_pixel(keypoints: F32 | None) -> F64 | None:
    """Return the middle of shoulders and hips in the image; None unless all four are confident."""
    if keypoints is None or keypoints.shape != (17, 3):
        return None
    torso = keypoints[TORSO].astype(np.float64)
    confident = np.isfinite(torso).all(axis=1) & (torso[:, 2] > KEYPOINT_CONFIDENCE_MIN)
    middle: F64 | None = torso[:, :2].mean(axis=0) if confident.all() else None
    return middle
