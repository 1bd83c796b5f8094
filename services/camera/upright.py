"""Upright images of a camera mounted upside down or sideways.

The detector expects upright people: with a rolled camera most people are missed, and headings of
the others are wrong.
"""

import math
from collections.abc import Iterable
from typing import TypeVar

import msgspec
import numpy as np
import numpy.typing as npt

from common.ros2.frame_names import frame_name
from people4d.messages import F64, CameraInfo, StaticTransform

T = TypeVar("T", bound=np.generic)

# Minimum component of gravity in the image: cameras steeper than 60 deg are not turned
LEAST_LEVEL = 0.5
# Optical frame to the frame of the image turned clockwise by 90 degrees: x' = -y, y' = x
TURN = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def quarter_turns(parent_from_optical: F64) -> int:
    """Return the number of clockwise quarter turns, 0 to 3, that make an image upright.

    Args:
        parent_from_optical: Pose of the camera (4x4) in a frame whose z points up.
    """
    right, down, _ = -parent_from_optical[2, :3]  # direction of gravity in the image
    if math.hypot(right, down) < LEAST_LEVEL:
        return 0
    return round(math.atan2(right, down) / (math.pi / 2)) % 4


def turns_of(transforms: Iterable[StaticTransform], frame_id: str) -> int:
    """Return the turns of the camera with a frame; 0 if its pose is not among the transforms."""
    poses = (transform.matrix for transform in transforms if transform.child == frame_id)
    return next((quarter_turns(matrix) for matrix in poses), 0)


def turned_image(image: npt.NDArray[T], turns: int) -> npt.NDArray[T]:
    """Return an image (HxW or HxWxC) turned clockwise by quarters."""
    return np.ascontiguousarray(np.rot90(image, -turns)) if turns else image


def turned_info(info: CameraInfo, turns: int) -> CameraInfo:
    """Return the calibration of the turned images, in a frame with another name."""
    if not turns:
        return info
    frame_id = frame_name(f"upright_{info.frame_id}")
    for _ in range(turns):
        k1, k2, p1, p2, *more = info.distortion or (0.0,) * 4
        info = msgspec.structs.replace(
            info,
            width=info.height,
            height=info.width,
            fx=info.fy,
            fy=info.fx,
            cx=info.height - 1 - info.cy,
            cy=info.cx,
            distortion=(k1, k2, p2, -p1, *more) if info.distortion else (),
        )
    return msgspec.structs.replace(info, frame_id=frame_id)


def turned_transforms(
    transforms: Iterable[StaticTransform], frame_id: str, turned: CameraInfo, turns: int
) -> list[StaticTransform]:
    """Return transforms, with the rotation of the turned images added to the camera pose."""
    optical_from_turned = np.linalg.matrix_power(TURN.T, turns)
    found = list(transforms)
    for transform in list(found):
        if turns and transform.child == frame_id:
            matrix = transform.matrix @ optical_from_turned
            found.append(msgspec.structs.replace(transform, child=turned.frame_id, matrix=matrix))
    return found
