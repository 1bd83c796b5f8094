"""Visible part of a person, from keypoints without images, with a body of capsules."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.geometry.transforms import apply, project
from people4d.messages import F64, CameraInfo

BOOL = npt.NDArray[np.bool_]

NEAREST_M = 0.1  # minimum depth of a keypoint [m]
APART_M = 0.1  # minimum distance of an occluder in front of a point [m]
BEHIND_M = -0.04  # minimum position of visible parts of the face, from the centre of the head [m]
EARS, TORSO = [3, 4], [5, 6, 11, 12]  # keypoints in COCO order

# Two keypoints (COCO order) and the radius of the capsule between them [m]
CAPSULES = (
    (3, 4, 0.12),  # head
    (5, 6, 0.09),
    (11, 12, 0.12),
    (5, 11, 0.11),
    (6, 12, 0.11),
    (5, 12, 0.11),
    (6, 11, 0.11),
    (5, 7, 0.055),  # arms
    (7, 9, 0.045),
    (6, 8, 0.055),
    (8, 10, 0.045),
    (11, 13, 0.085),  # legs
    (13, 15, 0.06),
    (12, 14, 0.085),
    (14, 16, 0.06),
)
BEGIN, END = np.array([c[:2] for c in CAPSULES]).T
RADIUS_M: F64 = np.array([c[2] for c in CAPSULES])

# Extent of the body beyond keypoints, sideways and upright [m]: crown, hands and feet have no
# keypoints
FACE, SHOULDER, ELBOW, HAND = (0.05, 0.05), (0.06, 0.06), (0.05, 0.05), (0.06, 0.10)
HIP, KNEE, FOOT = (0.08, 0.10), (0.06, 0.06), (0.07, 0.13)
EAR = (0.05, 0.14)
BY_KEYPOINT = (*[FACE] * 3, EAR, EAR, *[SHOULDER] * 2, *[ELBOW] * 2, *[HAND] * 2)
REACH_M: F64 = np.array([*BY_KEYPOINT, *[HIP] * 2, *[KNEE] * 2, *[FOOT] * 2])


@dataclass(frozen=True)
class Silhouette:
    """One person in the image."""

    keypoints_m: F64  # 17x3, frame: optical
    keypoints_px: F64  # 17x2
    visible: BOOL  # 17, True: in the image, occluded neither by others nor by itself
    box_xyxy_px: F64  # 4, box of the whole body, not cut to the image
    visible_share: float  # visible part of the body, 0 to 1


def silhouettes(
    people: list[F64], optical_from_map: F64, info: CameraInfo
) -> dict[int, Silhouette]:
    """Return the people in front of the camera by index, from 17x3 keypoints in the map."""
    in_camera = {k: apply(optical_from_map, person) for k, person in enumerate(people)}
    ahead = {k: points for k, points in in_camera.items() if points[:, 2].min() > NEAREST_M}
    return {
        k: _outline(points, [other for j, other in ahead.items() if j != k], info)
        for k, points in ahead.items()
    }


def _outline(keypoints_m: F64, others_m: list[F64], info: CameraInfo) -> Silhouette:
    middles_m = (keypoints_m[BEGIN] + keypoints_m[END]) / 2
    points_m = np.concatenate([keypoints_m, middles_m])
    pixels = project(points_m, info)
    unoccluded = np.all((pixels >= 0) & (pixels <= (info.width - 1, info.height - 1)), axis=1)
    for other_m in others_m:
        unoccluded &= ~hidden(points_m, pixels, other_m, info)
    keypoints_px = pixels[:17]
    reach_px = REACH_M * (info.fx, info.fy) / keypoints_m[:, 2:]
    box = np.concatenate(
        [(keypoints_px - reach_px).min(axis=0), (keypoints_px + reach_px).max(axis=0)]
    )
    visible = unoccluded[:17] & _faces_camera(keypoints_m)
    visible &= ~hidden(keypoints_m, keypoints_px, keypoints_m, info)
    return Silhouette(keypoints_m, keypoints_px, visible, box, float(unoccluded.mean()))


def hidden(points_m: F64, pixels: F64, other_m: F64, info: CameraInfo) -> BOOL:
    """Return the mask of points occluded by a person.

    Args:
        points_m: Points of the same or another person, Nx3, frame: optical.
        pixels: Pixels of the points, Nx2.
        other_m: Keypoints of the occluding person, 17x3, frame: optical.
        info: Calibration.
    """
    if other_m[:, 2].min() > points_m[:, 2].max():
        return np.zeros(len(points_m), np.bool_)
    other_px = project(other_m, info)
    begin, along = other_px[BEGIN], other_px[END] - other_px[BEGIN]
    from_begin = pixels[:, None] - begin
    length2 = np.maximum(np.sum(along**2, axis=1), 1e-9)
    part = np.clip(np.sum(from_begin * along, axis=2) / length2, 0, 1)
    distance_px = np.linalg.norm(from_begin - part[..., None] * along, axis=2)
    z_m = other_m[BEGIN, 2] + part * (other_m[END, 2] - other_m[BEGIN, 2])
    before = z_m < points_m[:, 2:] - APART_M
    inside = (distance_px < RADIUS_M * info.fx / z_m) & before
    return np.asarray(np.any(inside, axis=1))


def _faces_camera(keypoints_m: F64) -> BOOL:
    """Return the mask of keypoints that are not behind the head."""
    head_m = keypoints_m[EARS].mean(axis=0)
    towards_camera = -head_m / np.linalg.norm(head_m)
    faces = np.ones(17, np.bool_)
    faces[:5] = (keypoints_m[:5] - head_m) @ towards_camera > BEHIND_M
    return faces


def facing(keypoints_m: F64, up: F64) -> F64:
    """Return the horizontal heading of a chest, 3, unit length, given the direction up."""
    to_left = keypoints_m[5] - keypoints_m[6] + keypoints_m[11] - keypoints_m[12]
    forward = np.cross(to_left, up)
    length: float = max(float(np.linalg.norm(forward)), 1e-9)
    return forward / length


def sideways(keypoints_m: F64) -> float:
    """Return the orientation of a torso to the camera: 0 front or back, 1 side."""
    across = keypoints_m[5] - keypoints_m[6] + keypoints_m[11] - keypoints_m[12]
    view = keypoints_m[TORSO].mean(axis=0)
    return float(abs(across @ view) / max(np.linalg.norm(across) * np.linalg.norm(view), 1e-9))
