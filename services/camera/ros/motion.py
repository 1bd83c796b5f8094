"""Motion in messages of ROS: odometry, transforms over time, wheels."""

import math
from collections import Counter
from collections.abc import Container, Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from common.geometry.transforms import invert
from common.geometry.wheel_odometry import WheelConfig, WheelOdometry
from common.ros2.frame_names import frame_name
from common.ros2.transforms import StampedTransform
from people4d.errors import DecodeError
from people4d.messages import F64, MovingTransform, Odometry
from services.camera.ros.topics import JOINTS, ODOMETRY

CLIMB_MAX = 32  # maximum number of transforms from a camera to the root of its tree
FRAMES_MAX = 4096  # maximum number of frames, which bounds the memory
PLANAR = np.ix_((0, 1, 5), (0, 1, 5))  # x, y and yaw in the 6x6 covariance of ROS


class FrameTree:
    """Coordinate frames with their parents and the static transforms to them."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, F64 | None]] = {}

    def add_transform(self, parent: str, child: str, matrix: F64 | None = None) -> None:
        """Add a static transform (4x4, parent_from_child); None, moving, does not replace one."""
        _, known = self._parents.get(child, ("", None))
        if matrix is None and known is not None:
            return
        if len(self._parents) < FRAMES_MAX or child in self._parents:
            self._parents[child] = parent, matrix

    def path(self, frame: str) -> Iterator[tuple[str, str, F64 | None]]:
        """Yield parent, child and matrix of each transform from a frame to the root of its tree."""
        visited = {frame}
        while frame in self._parents and len(visited) <= CLIMB_MAX:
            parent, matrix = self._parents[frame]
            if parent in visited:  # a loop: not a tree
                return
            yield parent, frame, matrix
            visited.add(parent)
            frame = parent

    def find_transform(self, target: str, source: str) -> F64 | None:
        """Return target_from_source, None if no static path joins them."""
        of_source, of_target = (self._static(name.strip("/")) for name in (source, target))
        for frame, ancestor_from_source in of_source.items():
            if frame in of_target:
                return invert(of_target[frame]) @ ancestor_from_source
        return None

    def _static(self, frame: str) -> dict[str, F64]:
        """Return ancestor_from_frame of a frame and its static ancestors, nearest first."""
        found = {frame: np.eye(4)}
        for parent, child, matrix in self.path(frame):
            if matrix is None:
                break
            found[parent] = matrix @ found[child]
        return found


def odometry_of(message: Any, stamp_ns: int, sequence: int) -> Odometry:
    """Read a nav_msgs Odometry; DecodeError if its numbers cannot be used."""
    pose, twist = message.pose.pose, message.twist.twist
    q = pose.orientation
    yaw_rad = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
    covariance = np.array(message.pose.covariance, np.float64).reshape(6, 6)[PLANAR]
    try:
        return Odometry(
            stamp_ns=stamp_ns,
            sequence=sequence,
            frame_id=frame_name(message.header.frame_id),
            child_frame_id=frame_name(message.child_frame_id),
            x_m=pose.position.x,
            y_m=pose.position.y,
            theta_rad=yaw_rad,
            covariance=covariance if np.any(covariance) else None,
            twist=np.array([twist.linear.x, twist.linear.y, twist.angular.z]),
        )
    except ValueError as error:
        raise DecodeError(f"odometry: {error}") from error


class WheelReader:
    """Odometry of a base from wheel angles in joints or in two topics."""

    def __init__(self, config: WheelConfig) -> None:
        self._config = config
        self._odometry = WheelOdometry(config)
        self._left: float | None = None

    def joints(self, message: Any, stamp_ns: int) -> Odometry:
        """Read a sensor_msgs/JointState; DecodeError if it lacks a wheel or a valid number."""
        found = dict(zip(message.name, message.position.tolist(), strict=False))
        left, right = (found.get(name) for name in self._config.joints)
        if left is None or right is None:
            names = ", ".join(self._config.joints)
            raise DecodeError(
                f"joints: expected positions of {names}, got {list(message.name)!r:.80}"
            )
        return self._add(stamp_ns, left, right)

    def side(self, is_left: bool, message: Any, stamp_ns: int) -> Odometry | None:
        """Read a number of std_msgs; the number of the right wheel completes a pair."""
        value = float(message.data)
        if is_left:
            self._left = value
            return None
        return None if self._left is None else self._add(stamp_ns, self._left, value)

    def _add(self, stamp_ns: int, left: float, right: float) -> Odometry:
        if not (abs(left) < 2**53 and abs(right) < 2**53):  # NaN included
            raise DecodeError(f"wheels: expected finite positions, got {left}, {right}")
        return self._odometry.add_reading(stamp_ns, left, right)


class MotionReader:
    """Odometry and moving transforms in the messages of a source, and their counters.

    Args:
        counters: Counters of the source, to which `odometry`, `moving_transforms`, `bad_odometry`
            and `bad_transforms` are added.
        wheels: Wheels of the base.
        map_frame: Frame of ROS that is renamed to `map`.
    """

    def __init__(self, counters: Counter[str], wheels: WheelConfig, map_frame: str) -> None:
        self._counters, self._map_frame = counters, map_frame
        self._wheels = WheelReader(wheels)

    def odometry(
        self, kind: str, message: Any, stamp_ns: int, is_left: bool = False
    ) -> Iterator[Odometry]:
        """Yield the odometry in an Odometry, a JointState or the number of one wheel."""
        found: Odometry | None
        try:
            if kind == ODOMETRY:
                found = odometry_of(message, stamp_ns, self._counters["odometry"])
            elif kind == JOINTS:
                found = self._wheels.joints(message, stamp_ns)
            else:
                found = self._wheels.side(is_left, message, stamp_ns)
        except DecodeError:
            self._counters["bad_odometry"] += 1
            return
        if found:
            self._counters["odometry"] += 1
            yield found

    def transforms(
        self, edges: Iterable[StampedTransform], moving: Container[tuple[str, str]], default_ns: int
    ) -> Iterator[MovingTransform]:
        """Yield the transforms of moving pairs of frames; `default_ns` replaces a stamp of 0."""
        for edge in edges:
            if (edge.parent, edge.child) not in moving:
                continue
            parent = "map" if edge.parent == self._map_frame else edge.parent
            number = self._counters["moving_transforms"]
            try:
                moved = replace(edge, parent=parent).moving(edge.stamp_ns or default_ns, number)
            except DecodeError:
                self._counters["bad_transforms"] += 1
                continue
            self._counters["moving_transforms"] += 1
            yield moved
