"""Link from the frame of the tracks to the frame of odometry, if a recording lacks it.

A robot with localisation sends this transform. Without localisation the link is the true pose at
the start; `OdometryDrift` removes the later drift of odometry from the tracks.
"""

from collections.abc import Sequence

import numpy as np

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transforms import invert, rotation_from_rpy, transform_from
from evaluation.recordings.ground_truth import SampledTruth
from people4d.errors import SourceError
from people4d.messages import (
    F64,
    CameraInfo,
    Detections,
    Message,
    MovingTransform,
    Odometry,
    StaticTransform,
)

MOVING = (Odometry, MovingTransform)


def with_start_link(
    messages: Sequence[Message], truth: SampledTruth, info: CameraInfo, frame_id: str, source: str
) -> list[Message]:
    """Return the input of a tracker in which a moving camera is linked to the tracks' frame.

    SourceError if the camera moves, and neither transforms nor the truth link it to that frame.

    Args:
        messages: Input of a tracker.
        truth: Truth at the stamps of the detections, with known poses of the camera.
        info: Calibration of the camera.
        frame_id: Frame of the tracks.
        source: Name of the recording, for the error.
    """
    moving = [message for message in messages if isinstance(message, MOVING)]
    stamps_ns = [message.stamp_ns for message in messages if isinstance(message, Detections)]
    buffer = TransformBuffer(history_s=1e9)
    for message in messages:
        if isinstance(message, (StaticTransform, *MOVING)):
            buffer.add_transform(message)
    if not moving or _linked(buffer, frame_id, info.frame_id, stamps_ns):
        return list(messages)
    odom = next((m.frame_id for m in moving if isinstance(m, Odometry)), None)
    if odom is None or not _linked(buffer, odom, info.frame_id, stamps_ns):
        raise SourceError(
            f"{source} has a base that moves, but no transform leads from {info.frame_id} to it",
            "Record the transform: else the camera would be taken as the origin.",
        )
    matrix = _frame_from_odometry(buffer, odom, info.frame_id, truth, stamps_ns)
    if truth.frame_id != frame_id or matrix is None:
        raise SourceError(
            f"{source} has odometry, but no transform from {frame_id} to {odom}",
            "Record it, or evaluate with truth that contains the poses of the camera.",
        )
    link = StaticTransform(
        stamp_ns=messages[0].stamp_ns, sequence=0, parent=frame_id, child=odom, matrix=matrix
    )
    return [link, *messages]


def _linked(buffer: TransformBuffer, target: str, source: str, stamps_ns: Sequence[int]) -> bool:
    """Check for a transform at one or more of the stamps."""
    return any(buffer.lookup(target, source, stamp_ns) is not None for stamp_ns in stamps_ns)


def _frame_from_odometry(
    buffer: TransformBuffer, odom: str, camera: str, truth: SampledTruth, stamps_ns: Sequence[int]
) -> F64 | None:
    """Return the transform (4x4) from odometry to the truth's frame, by the first known pose."""
    for stamp_ns, people in zip(stamps_ns, truth.frames, strict=True):
        estimate = buffer.lookup(odom, camera, stamp_ns)
        if estimate is not None and people is not None and people.map_from_camera is not None:
            return _level(people.map_from_camera @ invert(estimate.matrix))
    return None


def _level(matrix: F64) -> F64:
    """Return a transform (4x4) with its yaw only: both frames have z up."""
    yaw_rad = float(np.arctan2(matrix[1, 0], matrix[0, 0]))
    return transform_from(matrix[:3, 3], rotation_from_rpy(0.0, 0.0, yaw_rad))
