"""Messages of ours as ROS 2 messages; images.py and camera.py convert the other way.

The functions return the fields of a message as nested mappings, from which `make` builds it.
"""

from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore
from scipy.spatial.transform import Rotation

from common.geometry.transforms import rotation_from_rpy
from common.io.images import encode_jpeg, encode_png16
from people4d.messages import F64, CameraInfo, Odometry, Track, Tracks, Truth, TruthPerson
from services.camera.ros.images import COMPRESSED_DEPTH_HEADER
from services.camera.ros.motion import PLANAR

QUALITY = 95  # of JPEG colour, so that coding it a second time adds little

Fields: TypeAlias = Mapping[str, Any]


def make(store: Typestore, kind: str, fields: Fields) -> Any:
    """Return a message; fields left out are zero."""
    values: dict[str, Any] = {}
    for name, (node, detail) in store.fielddefs[kind][1]:
        if node is Nodetype.NAME:
            values[name] = make(store, str(detail), fields.get(name, {}))
        elif node is Nodetype.SEQUENCE and detail[0][0] is Nodetype.NAME:
            values[name] = [make(store, str(detail[0][1]), item) for item in fields[name]]
        else:
            values[name] = fields.get(name, 0)
    return store.types[kind](**values)


def header(stamp_ns: int, frame_id: str) -> Fields:
    """Return a std_msgs/Header."""
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame_id}


def image(pixels: npt.NDArray[Any], head: Fields) -> Fields:
    """Return a sensor_msgs/Image of colour (HxWx3) or of depth (HxW, millimetres)."""
    rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
    return {
        "header": head,
        "height": pixels.shape[0],
        "width": pixels.shape[1],
        "encoding": "rgb8" if pixels.ndim == 3 else "16UC1",
        "step": rows.shape[1],
        "data": rows.reshape(-1),
    }


def compressed_image(pixels: npt.NDArray[Any], head: Fields) -> Fields:
    """Return a sensor_msgs/CompressedImage of colour (HxWx3) or of depth (HxW, millimetres).

    Depth is as compressed_depth_image_transport writes it.
    """
    if pixels.ndim == 3:
        layout, data = "rgb8; jpeg compressed bgr8", encode_jpeg(pixels, QUALITY)
    else:
        layout = "16UC1; compressedDepth png"
        data = COMPRESSED_DEPTH_HEADER.pack(0, 0.0, 0.0) + encode_png16(pixels)
    return {"header": head, "format": layout, "data": np.frombuffer(data, np.uint8)}


def camera_info(info: CameraInfo, head: Fields) -> Fields:
    """Return a sensor_msgs/CameraInfo."""
    k = np.array([info.fx, 0, info.cx, 0, info.fy, info.cy, 0, 0, 1], np.float64)
    none = info.distortion_model == "none"
    return {
        "header": head,
        "height": info.height,
        "width": info.width,
        "distortion_model": "plumb_bob" if none else info.distortion_model,
        "d": np.zeros(5) if none else np.array(info.distortion, np.float64),
        "k": k,
        "r": np.eye(3).ravel(),
        "p": np.insert(k.reshape(3, 3), 3, 0.0, axis=1).ravel(),
    }


def odometry(message: Odometry) -> Fields:
    """Return a nav_msgs/Odometry; unknown numbers are 0, as in ROS."""
    covariance = np.zeros((6, 6))
    if message.covariance is not None:
        covariance[PLANAR] = message.covariance
    vx, vy, omega = message.twist.tolist() if message.twist is not None else (0.0, 0.0, 0.0)
    rotation = rotation_from_rpy(0.0, 0.0, message.theta_rad)
    pose = {
        "position": _xyz((message.x_m, message.y_m, 0.0)),
        "orientation": _quaternion(rotation),
    }
    twist = {"linear": _xyz((vx, vy, 0.0)), "angular": _xyz((0.0, 0.0, omega))}
    return {
        "header": header(message.stamp_ns, message.frame_id),
        "child_frame_id": message.child_frame_id,
        "pose": {"pose": pose, "covariance": covariance.ravel()},
        "twist": {"twist": twist, "covariance": np.zeros(36)},
    }


def transforms(edges: Iterable[tuple[str, str, F64]], stamp_ns: int) -> Fields:
    """Return a tf2_msgs/TFMessage of parents, children and 4x4 parent_from_child."""
    stamped = [
        {
            "header": header(stamp_ns, parent),
            "child_frame_id": child,
            "transform": {
                "translation": _xyz(matrix[:3, 3]),
                "rotation": _quaternion(matrix[:3, :3]),
            },
        }
        for parent, child, matrix in edges
    ]
    return {"transforms": stamped}


def people(message: Truth | Tracks) -> Fields:
    """Return people_msgs/People; tags hold yaw, direction of walking, and state of a track."""
    persons = message.people if isinstance(message, Truth) else message.tracks
    head = header(message.stamp_ns, message.frame_id)
    return {"header": head, "people": [_person(person) for person in persons]}


def _person(person: TruthPerson | Track) -> Fields:
    tags: dict[str, str] = {}
    angles = {"yaw_rad": person.yaw_rad}
    if isinstance(person, Track):
        tags["state"] = person.state
    else:
        angles["path_yaw_rad"] = person.path_yaw_rad
    tags |= {name: repr(float(angle)) for name, angle in angles.items() if angle is not None}
    return {
        "name": str(person.id),
        "position": _xyz(person.position_m),
        "velocity": _xyz((0, 0, 0) if person.velocity_mps is None else person.velocity_mps),
        "reliability": person.score if isinstance(person, Track) else 1.0,
        "tagnames": list(tags),
        "tags": list(tags.values()),
    }


def _quaternion(rotation: F64) -> Fields:
    return dict(zip("xyzw", Rotation.from_matrix(rotation).as_quat().tolist(), strict=True))


def _xyz(values: npt.ArrayLike) -> Fields:
    return dict(zip("xyz", np.asarray(values, np.float64).tolist(), strict=True))
