"""Conversion of messages to the input of trackers."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from common.geometry.transform_history import TransformEstimate
from common.geometry.transforms import apply
from people4d.messages import F64, CameraInfo, Detection, Detections, Embeddings
from people4d.messages.base import MAX_CAMERAS, MAX_M
from services.tracker.cameras.frame_join import PendingFrame
from services.tracker.cameras.poses import CameraPoseLookup, pose_covariance
from services.tracker.interface import (
    ImageEdges,
    Measurement,
    Observation,
    UnlocatedDetection,
)

PEOPLE_MAX = 128  # maximum number of detections of a frame; matching takes cubic time
PERSON_LIMIT = 1e-3  # minimum probability of a person, and of something else
POSE_SIGMA_MIN_M = 0.01  # minimum standard deviation of a pose that counts [m]
RANGE_MAX_M = 100.0  # maximum accepted distance of a position from the camera [m]
LENGTH_MIN = 1e-6  # minimum length of a usable embedding
LEVEL_MIN = 0.2  # minimum horizontal part of a heading with a yaw (78 deg steep)


class FrameObserver:
    """Conversion of frames to observations, by the poses of their cameras.

    Args:
        poses: Poses of the cameras.
        counters: Counters of dropped data.
    """

    def __init__(self, poses: CameraPoseLookup, counters: Counter[str]) -> None:
        self._poses, self._counters = poses, counters
        self._edges: dict[str, ImageEdges] = {}  # edges of the image by camera, see Observation
        self._embedder = ""  # name of the model of the last embeddings

    def add_calibration(self, info: CameraInfo) -> None:
        """Store the edges of a camera's image."""
        if info.camera in self._edges or len(self._edges) < MAX_CAMERAS:
            self._edges[info.camera] = edges(info)

    def observe(self, frame: PendingFrame) -> Observation | None:
        """Return the observation of a frame; None, counted, without a pose of its camera."""
        detections = frame.detections
        pose = self._poses.lookup(detections.frame_id, frame.time_ns)
        if pose is None:
            self._counters["no_transform"] += 1
            return None
        self._counters["predicted_base"] += pose.is_uncertain
        observation = observe(detections, frame.embeddings, pose, self._counters)
        self._embedder = observation.embedder or self._embedder
        return replace(
            observation,
            stamp_ns=frame.time_ns,
            embedder=self._embedder,
            edges=self._edges.get(detections.camera),
        )


def observe(
    detections: Detections,
    embeddings: Embeddings | None,
    pose: TransformEstimate,
    counters: Counter[str],
) -> Observation:
    """Return the usable detections of one frame; count the others.

    Positions with a coordinate beyond RANGE_MAX_M are dropped. Of more than PEOPLE_MAX detections
    the lowest scores are dropped.

    Args:
        detections: Detections of the frame.
        embeddings: Embeddings of the detections, or None.
        pose: Pose of the camera in the tracking frame.
        counters: Counters of dropped data.
    """
    people, map_from_camera = detections.detections, pose.matrix
    vectors = _unit_vectors(embeddings, len(people), counters) if embeddings else {}
    positions_m = _positions_m(people, map_from_camera)
    covariances_m2 = _covariances_m2(people, map_from_camera)
    measurements, unlocated = list[Measurement](), list[UnlocatedDetection]()
    numbered = list(enumerate(people))
    if len(people) > PEOPLE_MAX:
        counters["too_many"] += len(people) - PEOPLE_MAX
        numbered = sorted(numbered, key=lambda item: -item[1].score)[:PEOPLE_MAX]
    for index, person in numbered:
        left, top, right, bottom = person.box_xyxy_px.tolist()
        if right - left < 1.0 or bottom - top < 1.0:
            counters["empty_boxes"] += 1
        elif person.position_m is None or index not in positions_m:
            counters["without_position" if person.position_m is None else "out_of_range"] += 1
            unlocated.append(UnlocatedDetection(index, person.box_xyxy_px, person.score))
        else:
            yaw_rad = yaw_of(person.heading, map_from_camera)
            measurements.append(
                Measurement(
                    index=index,
                    box_xyxy_px=person.box_xyxy_px,
                    score=person.score,
                    person_log_odds=log_odds(person.person),
                    position_m=positions_m[index],
                    forward_m=float(person.position_m[2]),
                    covariance_m2=covariances_m2.get(index),
                    embedding=vectors.get(index),
                    yaw_rad=yaw_rad,
                    yaw_sigma_rad=person.heading_sigma_rad,
                    bearing_rad=math.atan2(*(positions_m[index] - map_from_camera[:3, 3])[1::-1]),
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
        base=pose.base,
    )


def _positions_m(people: Sequence[Detection], map_from_camera: F64) -> dict[int, F64]:
    """Return positions in the map by index, if near enough to the camera and the map's origin."""
    known = {i: p.position_m for i, p in enumerate(people) if p.position_m is not None}
    if not known:
        return {}
    in_camera = np.array(list(known.values()))
    # Separate products: the rounding of a position must not depend on the other positions.
    in_map = apply(map_from_camera, in_camera[:, None])[:, 0]
    near = np.abs(in_camera).max(axis=1) <= RANGE_MAX_M
    near &= np.abs(in_map).max(axis=1) <= MAX_M / 2
    return {index: in_map[k] for k, index in enumerate(known) if near[k]}


def _covariances_m2(people: Sequence[Detection], map_from_camera: F64) -> dict[int, F64]:
    """Return the known covariances (3x3) in the map by index."""
    covariances_m2 = ((i, p.position_covariance_m2) for i, p in enumerate(people))
    known = {i: covariance for i, covariance in covariances_m2 if covariance is not None}
    stacked = np.array(list(known.values()))
    return dict(zip(known, rotated(stacked, map_from_camera), strict=True)) if known else {}


def edges(info: CameraInfo) -> ImageEdges:
    """Return the edges of a camera's image."""
    return ImageEdges(
        left=-info.cx / info.fx,
        right=(info.width - info.cx) / info.fx,
        top=-info.cy / info.fy,
        bottom=(info.height - info.cy) / info.fy,
    )


def rotated(covariances_m2: F64, map_from_camera: F64) -> F64:
    """Return covariances (...x3x3) in the map, from the camera's frame."""
    turn = map_from_camera[:3, :3]
    result: F64 = turn @ covariances_m2 @ turn.T
    return (result + result.swapaxes(-1, -2)) / 2


def yaw_of(heading: F64 | None, map_from_camera: F64) -> float | None:
    """Return the yaw in the map of a heading (3, optical frame); None if unknown or steep."""
    if heading is None:
        return None
    x, y, _ = (map_from_camera[:3, :3] @ heading).tolist()
    return math.atan2(y, x) if math.hypot(x, y) >= LEVEL_MIN else None


def log_odds(probability: float | None) -> float:
    """Return the log-odds of a probability, at most ±6.9; 0 if it is unknown."""
    if probability is None:
        return 0.0
    limited = min(max(probability, PERSON_LIMIT), 1 - PERSON_LIMIT)
    return math.log(limited / (1 - limited))


def _unit_vectors(embeddings: Embeddings, count: int, counters: Counter[str]) -> dict[int, F64]:
    """Return embeddings of unit length by index of their detection."""
    vectors: dict[int, F64] = {}
    rows = embeddings.vectors.astype(np.float64)
    lengths = np.sqrt(np.einsum("ij,ij->i", rows, rows))
    rows /= np.maximum(lengths, LENGTH_MIN)[:, None]
    known = (lengths > LENGTH_MIN).tolist()
    for index, vector, is_known in zip(embeddings.detections, rows, known, strict=True):
        if 0 <= index < count and index not in vectors and is_known:
            vectors[index] = vector
        else:
            counters["bad_embeddings"] += 1
    return vectors
