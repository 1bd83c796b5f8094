"""Packets of a frame for the page: people, boxes, cameras, robot."""

import math
from typing import Any

import numpy as np

from common.drawing.people import ARROW_M, CameraView
from common.geometry.keypoints import lift
from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transforms import apply, invert
from people4d.messages import (
    F64,
    CameraInfo,
    CompressedRgbdFrame,
    Detections,
    Event,
    Message,
    MovingTransform,
    Odometry,
    PersonSkeleton,
    Predictions,
    RgbdFrame,
    Skeletons,
    StaticTransform,
    Track,
    Tracks,
)
from services.dashboard.images import depth_cloud, encode_image
from services.dashboard.selection import CAMERAS_MAX, Key

OBJECT_MIN = 0.9  # minimum probability of a displayed object


def person_of(track: Track, camera_m: F64 | None) -> dict[str, Any]:
    """Return a person; `camera_m` is the position of the camera [m], None if unknown."""
    c = track.covariance
    return {
        "id": track.id,
        "state": track.state,
        "position_m": _rounded(track.position_m),
        "velocity_mps": _rounded(track.velocity_mps),
        "yaw_rad": track.yaw_rad,
        "covariance_m2": [float(c[0, 0]), float(c[0, 1]), float(c[1, 1])],
        "distance_m": None
        if camera_m is None
        else round(float(np.linalg.norm(track.position_m - camera_m)), 3),
        "identity": track.identity,
        "confidence": track.identity_confidence,
        "reason": track.identity_reason,
        "hits": track.hits,
        "unseen_s": track.time_since_update_s,
        "detection": track.detection,
    }


def boxes_of(detections: Detections, tracks: Tracks | None) -> list[dict[str, Any]]:
    """Return boxes and keypoints of a frame, with the identities of their tracks."""
    owners = {t.detection: t.id for t in tracks.tracks} if tracks else {}
    return [
        {
            "id": owners.get(number),
            "box_px": np.round(one.box_xyxy_px.astype(float), 1).tolist(),
            "score": round(one.score, 3),
            "keypoints": None
            if one.keypoints is None
            else np.round(one.keypoints.astype(float), 2).ravel().tolist(),
        }
        for number, one in enumerate(detections.detections)
    ]


def arrows_of(tracks: Tracks, view: CameraView) -> dict[int, list[float]]:
    """Return the arrows of headings in the image [px]: u, v of start and tip, by id."""
    arrows = {}
    for track in tracks.tracks:
        yaw = track.yaw_rad
        ahead = np.zeros(3)
        if yaw is not None:
            ahead = ARROW_M * np.array([math.cos(yaw), math.sin(yaw), 0.0])
        ends = view.pixels(np.stack([track.position_m, track.position_m + ahead]))
        if ends is not None and np.abs(ends).max() < 1e5:
            arrows[track.id] = np.round(ends, 1).ravel().tolist()
    return arrows


def camera_of(info: CameraInfo, pose: F64 | None) -> dict[str, Any]:
    """Return a camera's image size, and its field of view on the map if its pose is known."""
    camera: dict[str, Any] = {"width": info.width, "height": info.height, "field_m": None}
    if pose is not None:
        camera["pose"] = pose.ravel().tolist()
        corners = [((u - info.cx) / info.fx, 0.0, 1.0) for u in (0, info.width)]
        rays = np.array(corners) @ pose[:3, :3].T
        flat = rays[:, :2]
        lengths = np.linalg.norm(flat, axis=1)
        if lengths.min() > 1e-3:
            ends = pose[:2, 3] + flat / lengths[:, None] * info.max_depth_m
            camera["field_m"] = np.round([pose[:2, 3], *ends], 3).tolist()
    return camera


def predictions_of(predictions: Predictions) -> list[dict[str, Any]]:
    """Return the expected paths, and their standard deviations on the ground."""
    return [
        {
            "id": person.id,
            "path_m": np.round(person.means_m, 3).tolist(),
            "sigma_m": np.round(
                np.sqrt((person.covariances_m2[:, 0, 0] + person.covariances_m2[:, 1, 1]) / 2), 3
            ).tolist(),
            "group": person.group,
        }
        for person in predictions.people
    ]


def skeletons_of(skeletons: Skeletons) -> dict[str, Any]:
    """Return the joints of each person and the predicted ones among them, by id."""
    people = skeletons.people
    return {
        "type": "skeletons",
        "joints": {one.id: _joints(one.positions_m.astype(float)) for one in people},
        "predicted": {
            one.id: [joint for joint, measured in enumerate(one.measured) if not measured]
            for one in people
        },
        "postures": {one.id: name for one in people if (name := _posture(one)) != "unknown"},
    }


def _posture(one: PersonSkeleton) -> str:
    """Return the posture of a person, or "object-like" for a probable object."""
    return "object-like" if one.object_like >= OBJECT_MIN else one.posture


def event_of(event: Event, at_ms: float) -> dict[str, Any]:
    """Return an event; `at_ms` is its arrival, used if its time is unknown."""
    at_ms = at_ms if event.wall_ns is None else event.wall_ns / 1e6
    return {
        "type": "event",
        "at_ms": at_ms,
        "number": event.sequence,
        "kind": event.kind,
        "id": event.id,
        "zone": event.zone,
        "dwell_s": event.dwell_s,
        "count": event.count,
        "distance_m": event.distance_m,
        "confidence": event.confidence,
        "reason": event.reason,
    }


def _joints(points_m: F64) -> list[list[float] | None]:
    """Return joints x, y, z [m], None for unknown joints."""
    rows = np.round(points_m, 3).tolist()
    return [row if math.isfinite(row[0]) else None for row in rows]


def _rounded(vector: F64) -> list[float]:
    return [round(float(value), 3) for value in vector]


class SceneBuilder:
    """Builds scenes from the messages of a frame and the known poses."""

    def __init__(self, base_frame: str) -> None:
        self._base_frame = base_frame
        self._transforms = TransformBuffer()
        self._infos: dict[str, CameraInfo] = {}
        self._frame_id = "map"

    def add_message(self, message: Message) -> None:
        """Add a calibration or transform."""
        if isinstance(message, CameraInfo):
            if message.camera in self._infos or len(self._infos) < CAMERAS_MAX:
                self._infos[message.camera] = message
        elif isinstance(message, StaticTransform | MovingTransform | Odometry):
            self._transforms.add_transform(message)

    def scene(
        self, key: Key, detections: Detections | None, tracks: Tracks | None
    ) -> dict[str, Any]:
        """Return the scene of a frame, without detections or tracks if they are unknown."""
        camera, stamp_ns = key
        if tracks:
            self._frame_id = tracks.frame_id
        pose, info = self._pose(camera, stamp_ns), self._infos.get(camera)
        camera_m = None if pose is None else pose[:3, 3]
        scene: dict[str, Any] = {
            "type": "scene",
            "camera": camera,
            "frame": str(stamp_ns),  # text, since JavaScript's numbers have 53 bits
            "frame_id": self._frame_id,
            "people": [person_of(track, camera_m) for track in tracks.tracks] if tracks else None,
            "boxes": boxes_of(detections, tracks) if detections else [],
            "arrows": {},
            "cameras": {
                name: camera_of(info, self._pose(name, stamp_ns))
                for name, info in self._infos.items()
            },
            "robot": self._robot(stamp_ns),
            "joints": {},
        }
        if info and pose is not None and tracks:
            scene["arrows"] = arrows_of(tracks, CameraView(info, invert(pose)))
            if detections:
                scene["joints"] = self._joints(detections, tracks, info, pose)
        return scene

    def image(self, frame: RgbdFrame | CompressedRgbdFrame) -> dict[str, Any]:
        """Return the image of a frame."""
        jpeg = encode_image(frame.rgb) if isinstance(frame, RgbdFrame) else frame.rgb_jpeg
        return {"camera": frame.camera, "jpeg": jpeg}

    def cloud(self, frame: RgbdFrame) -> dict[str, Any] | None:
        """Return the depth cloud of a frame, None if the pose of its camera is unknown."""
        info, pose = self._infos.get(frame.camera), self._pose(frame.camera, frame.stamp_ns)
        if info is None or pose is None:
            return None
        return depth_cloud(frame.rgb, frame.depth_mm, info, pose)

    def _pose(self, camera: str, stamp_ns: int) -> F64 | None:
        info = self._infos.get(camera)
        if info is None:
            return None
        return self._transforms.camera_pose(self._frame_id, info.frame_id, stamp_ns)

    def _robot(self, stamp_ns: int) -> list[float] | None:
        """Return x, y [m] and yaw [rad] of the robot's base, None if unknown."""
        base = self._transforms.lookup(self._frame_id, self._base_frame, stamp_ns)
        if base is None:
            return None
        matrix = base.matrix
        yaw = math.atan2(matrix[1, 0], matrix[0, 0])
        return [float(matrix[0, 3]), float(matrix[1, 3]), yaw]

    def _joints(
        self, detections: Detections, tracks: Tracks, info: CameraInfo, pose: F64
    ) -> dict[int, list[list[float] | None]]:
        """Return the keypoints of each tracked person in 3D, by id."""
        found = {}
        for track in tracks.tracks:
            person = detections.at(track.detection)
            points_m = lift(person, info) if person else None
            if points_m is not None:
                found[track.id] = _joints(apply(pose, points_m))
        return found
