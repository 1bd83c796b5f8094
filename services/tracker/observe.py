"""Conversion of messages to the input of trackers."""

import math
from collections import Counter

import numpy as np

from common.geometry.transform_history import TransformEstimate
from common.geometry.transforms import apply
from people4d.messages import F64, CameraInfo, Detections, Embeddings
from services.tracker.camera_poses import pose_covariance
from services.tracker.interface import Measurement, Observation, UnlocatedDetection

POSE_SIGMA_MIN_M = 0.01  # [m] a better known pose adds no covariance
LEVEL_MIN = 0.2  # a heading with a shorter level part (steeper than 78 deg) has no yaw


def observe(
    detections: Detections,
    embeddings: Embeddings | None,
    pose: TransformEstimate,
    max_range_m: float,
    counters: Counter[str],
) -> Observation:
    """Return the usable detections of one frame; the others are counted.

    The pose is that of the camera in the tracking frame; positions with a coordinate beyond
    `max_range_m` are dropped.
    """
    vectors = _unit_vectors(embeddings, len(detections.detections), counters) if embeddings else {}
    map_from_camera = pose.matrix
    measurements, unlocated = list[Measurement](), list[UnlocatedDetection]()
    for index, person in enumerate(detections.detections):
        left, top, right, bottom = map(float, person.box_xyxy_px)
        if right - left < 1.0 or bottom - top < 1.0:
            counters["empty_boxes"] += 1
        elif person.position_m is None or np.abs(person.position_m).max() > max_range_m:
            counters["without_position" if person.position_m is None else "out_of_range"] += 1
            unlocated.append(UnlocatedDetection(index, person.box_xyxy_px, person.score))
        else:
            measurements.append(
                Measurement(
                    index=index,
                    box_xyxy_px=person.box_xyxy_px,
                    score=person.score,
                    position_m=apply(map_from_camera, person.position_m),
                    forward_m=float(person.position_m[2]),
                    covariance_m2=rotated(person.position_covariance_m2, map_from_camera),
                    embedding=vectors.get(index),
                    yaw_rad=yaw_of(person.heading, map_from_camera),
                    yaw_sigma_rad=person.heading_sigma_rad,
                    added_covariance_m2=pose_covariance(
                        map_from_camera[:3, :3] @ person.position_m, pose
                    )
                    if pose.sigma_m > POSE_SIGMA_MIN_M
                    else None,
                )
            )
    return Observation(
        stamp_ns=detections.stamp_ns,
        measurements=tuple(measurements),
        camera=detections.camera,
        embedder=embeddings.model if embeddings else "",
        map_from_camera=map_from_camera,
        size_px=(detections.width, detections.height),
        unlocated=tuple(unlocated),
        turn_sigma_rad=pose.sigma_rad,
    )


def edges(info: CameraInfo) -> tuple[float, float]:
    """Return the left and right edge of a camera's image at focal length 1, x right."""
    return -info.cx / info.fx, (info.width - info.cx) / info.fx


def rotated(covariance_m2: F64 | None, map_from_camera: F64) -> F64 | None:
    """Return a covariance (3x3) of the camera's frame in the map; None if it is unknown."""
    if covariance_m2 is None:
        return None
    result: F64 = map_from_camera[:3, :3] @ covariance_m2 @ map_from_camera[:3, :3].T
    return (result + result.T) / 2


def yaw_of(heading: F64 | None, map_from_camera: F64) -> float | None:
    """Return the yaw in the map of a heading (3, optical frame); None if unknown or steep."""
    if heading is None:
        return None
    x, y, _ = map_from_camera[:3, :3] @ heading
    return math.atan2(y, x) if math.hypot(x, y) >= LEVEL_MIN else None


def _unit_vectors(embeddings: Embeddings, count: int, counters: Counter[str]) -> dict[int, F64]:
    """Return the embeddings by index of their detection, at unit length."""
    vectors: dict[int, F64] = {}
    for index, vector in zip(embeddings.detections, embeddings.vectors, strict=True):
        long_vector = vector.astype(np.float64)
        length = float(np.linalg.norm(long_vector))
        if 0 <= index < count and index not in vectors and length > 1e-6:
            vectors[index] = long_vector / length
        else:
            counters["bad_embeddings"] += 1
    return vectors
