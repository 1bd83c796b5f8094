"""Shared parts of messages of ROS."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from common.geometry.transforms import rotation_from_rpy
from common.ros2.types import Fields
from people4d.messages import F64, Odometry

HEADER = "std_msgs/msg/Header"
ODOMETRY = "nav_msgs/msg/Odometry"
TF = "tf2_msgs/msg/TFMessage"
CLOCK = "rosgraph_msgs/msg/Clock"

PLANAR = np.ix_((0, 1, 5), (0, 1, 5))  # x, y and yaw in the 6x6 covariance of ROS


def time(nanoseconds: int) -> Fields:
    """Return a builtin_interfaces/Time or Duration."""
    seconds, rest = divmod(nanoseconds, 10**9)
    return {"sec": seconds, "nanosec": rest}


def header(stamp_ns: int, frame_id: str) -> Fields:
    """Return a std_msgs/Header."""
    return {"stamp": time(stamp_ns), "frame_id": frame_id}


def xyz(values: Sequence[float]) -> Fields:
    """Return a Point or Vector3."""
    return {"x": values[0], "y": values[1], "z": values[2]}


def yaw_quaternion(yaw_rad: float) -> Fields:
    """Return the Quaternion of a rotation about z."""
    return {"z": math.sin(yaw_rad / 2), "w": math.cos(yaw_rad / 2), "x": 0.0, "y": 0.0}


def quaternion(rotation: F64) -> Fields:
    """Return the Quaternion of a 3x3 rotation."""
    return dict(zip("xyzw", Rotation.from_matrix(rotation).as_quat().tolist(), strict=True))


def pose(position: Sequence[float], yaw_rad: float) -> Fields:
    """Return an upright Pose."""
    return {"position": xyz(position), "orientation": yaw_quaternion(yaw_rad)}


def transforms(edges: Iterable[tuple[str, str, F64]], stamp_ns: int) -> Fields:
    """Return a tf2_msgs/TFMessage from parents, children and 4x4 parent_from_child."""
    stamped = [
        {
            "header": header(stamp_ns, parent),
            "child_frame_id": child,
            "transform": {
                "translation": xyz(matrix[:3, 3].tolist()),
                "rotation": quaternion(matrix[:3, :3]),
            },
        }
        for parent, child, matrix in edges
    ]
    return {"transforms": stamped}


def odometry(message: Odometry, frame_id: str = "", child_frame_id: str = "") -> Fields:
    """Return a nav_msgs/Odometry between two frames, with 0 for unknown values as in ROS."""
    covariance = np.zeros((6, 6))
    if message.covariance is not None:
        covariance[PLANAR] = message.covariance
    vx, vy, omega = message.twist.tolist() if message.twist is not None else (0.0, 0.0, 0.0)
    position = {
        "position": xyz((message.x_m, message.y_m, 0.0)),
        "orientation": quaternion(rotation_from_rpy(0.0, 0.0, message.theta_rad)),
    }
    twist = {"linear": xyz((vx, vy, 0.0)), "angular": xyz((0.0, 0.0, omega))}
    return {
        "header": header(message.stamp_ns, frame_id or message.frame_id),
        "child_frame_id": child_frame_id or message.child_frame_id,
        "pose": {"pose": position, "covariance": covariance},
        "twist": {"twist": twist},
    }
