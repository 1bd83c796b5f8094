"""Messages of ours as ROS 2 messages; images.py and calibration.py convert the other way."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore
from scipy.spatial.transform import Rotation

from common.geometry.transform_buffer import transform_from_odometry
from common.geometry.transforms import rotation_from_rpy
from people4d.messages import (
    F64,
    CameraInfo,
    MovingTransform,
    Odometry,
    StaticTransform,
    Tracks,
    Truth,
)
from services.camera.ros.images import COMPRESSED_DEPTH_HEADER
from services.camera.ros.types import PEOPLE, ros2_types

PERSON_DEFINITION = """
string name
geometry_msgs/Point position
geometry_msgs/Point velocity
float64 reliability
string[] tagnames
string[] tags
"""
PEOPLE_DEFINITION = "std_msgs/Header header\npeople_msgs/Person[] people\n"

PLANAR = np.ix_((0, 1, 5), (0, 1, 5))  # x, y and yaw in the 6x6 covariance of ROS


def export_types() -> Typestore:
    """Return the types of ROS 2 with people_msgs."""
    store = ros2_types()
    store.register(get_types_from_msg(PERSON_DEFINITION, "people_msgs/msg/Person"))
    store.register(get_types_from_msg(PEOPLE_DEFINITION, PEOPLE))
    return store


class RosMessages:
    """Makes messages of ROS 2.

    Args:
        store: Types, see `export_types`.
    """

    def __init__(self, store: Typestore) -> None:
        self._store = store

    def image(self, pixels: npt.NDArray[Any], encoding: str, stamp_ns: int, frame: str) -> Any:
        """Return a sensor_msgs/Image; HxWx3 for rgb8, HxW of 16 bits for 16UC1."""
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
        return self._make(
            "sensor_msgs/msg/Image",
            header=self._header(stamp_ns, frame),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=rows.shape[1],
            data=rows.reshape(-1),
        )

    def jpeg(self, data: bytes, stamp_ns: int, frame: str) -> Any:
        """Return a sensor_msgs/CompressedImage of colour."""
        return self._compressed(data, "rgb8; jpeg compressed bgr8", stamp_ns, frame)

    def depth_png(self, data: bytes, stamp_ns: int, frame: str) -> Any:
        """Return a sensor_msgs/CompressedImage as compressed_depth_image_transport writes it."""
        head = COMPRESSED_DEPTH_HEADER.pack(0, 0.0, 0.0)
        return self._compressed(head + data, "16UC1; compressedDepth png", stamp_ns, frame)

    def camera_info(self, info: CameraInfo, stamp_ns: int) -> Any:
        """Return a sensor_msgs/CameraInfo."""
        k = np.array([info.fx, 0, info.cx, 0, info.fy, info.cy, 0, 0, 1], np.float64)
        p = np.insert(k.reshape(3, 3), 3, 0.0, axis=1).ravel()
        none = info.distortion_model == "none"
        roi = self._make(
            "sensor_msgs/msg/RegionOfInterest",
            **dict.fromkeys(("x_offset", "y_offset", "height", "width"), 0),
            do_rectify=False,
        )
        return self._make(
            "sensor_msgs/msg/CameraInfo",
            header=self._header(stamp_ns, info.frame_id),
            height=info.height,
            width=info.width,
            distortion_model="plumb_bob" if none else info.distortion_model,
            d=np.zeros(5) if none else np.array(info.distortion, np.float64),
            k=k,
            r=np.eye(3).ravel(),
            p=p,
            binning_x=0,
            binning_y=0,
            roi=roi,
        )

    def odometry(self, odometry: Odometry) -> Any:
        """Return a nav_msgs/Odometry; unknown numbers are 0, as in ROS."""
        covariance = np.zeros((6, 6))
        if odometry.covariance is not None:
            covariance[PLANAR] = odometry.covariance
        vx, vy, omega = odometry.twist.tolist() if odometry.twist is not None else (0.0, 0.0, 0.0)
        pose = self._make(
            "geometry_msgs/msg/Pose",
            position=self._vector("Point", (odometry.x_m, odometry.y_m, 0.0)),
            orientation=self._quaternion(rotation_from_rpy(0.0, 0.0, odometry.theta_rad)),
        )
        twist = self._make(
            "geometry_msgs/msg/Twist",
            linear=self._vector("Vector3", (vx, vy, 0.0)),
            angular=self._vector("Vector3", (0.0, 0.0, omega)),
        )
        return self._make(
            "nav_msgs/msg/Odometry",
            header=self._header(odometry.stamp_ns, odometry.frame_id),
            child_frame_id=odometry.child_frame_id,
            pose=self._make(
                "geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance.ravel()
            ),
            twist=self._make(
                "geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)
            ),
        )

    def transforms(
        self, transforms: Sequence[StaticTransform | MovingTransform], stamp_ns: int
    ) -> Any:
        """Return a tf2_msgs/TFMessage."""
        stamped = [
            self._make(
                "geometry_msgs/msg/TransformStamped",
                header=self._header(stamp_ns, transform.parent),
                child_frame_id=transform.child,
                transform=self._transform(transform.matrix),
            )
            for transform in transforms
        ]
        return self._make("tf2_msgs/msg/TFMessage", transforms=stamped)

    def base_transform(self, odometry: Odometry) -> Any:
        """Return odometry as a tf2_msgs/TFMessage."""
        moved = StaticTransform(
            stamp_ns=odometry.stamp_ns,
            sequence=0,
            parent=odometry.frame_id,
            child=odometry.child_frame_id,
            matrix=transform_from_odometry(odometry),
        )
        return self.transforms([moved], odometry.stamp_ns)

    def truth(self, truth: Truth) -> Any:
        """Return ground truth as people_msgs/People; tags hold the yaw of chest and of walking."""
        people = [
            self._person(
                person.id,
                (person.position_m, person.velocity_mps),
                1.0,
                _tags(yaw_rad=person.yaw_rad, path_yaw_rad=person.path_yaw_rad),
            )
            for person in truth.people
        ]
        return self._people(truth.stamp_ns, truth.frame_id, people)

    def tracks(self, tracks: Tracks) -> Any:
        """Return tracked people as people_msgs/People; tags hold state and yaw."""
        people = [
            self._person(
                str(track.id),
                (track.position_m, track.velocity_mps),
                track.score,
                {"state": track.state} | _tags(yaw_rad=track.yaw_rad),
            )
            for track in tracks.tracks
        ]
        return self._people(tracks.stamp_ns, tracks.frame_id, people)

    def _people(self, stamp_ns: int, frame: str, people: list[Any]) -> Any:
        return self._make(PEOPLE, header=self._header(stamp_ns, frame), people=people)

    def _person(
        self, name: str, motion: tuple[F64, F64 | None], score: float, tags: Mapping[str, str]
    ) -> Any:
        position_m, velocity_mps = motion
        return self._make(
            "people_msgs/msg/Person",
            name=name,
            position=self._vector("Point", position_m),
            velocity=self._vector("Point", (0, 0, 0) if velocity_mps is None else velocity_mps),
            reliability=score,
            tagnames=list(tags),
            tags=list(tags.values()),
        )

    def _make(self, kind: str, **fields: Any) -> Any:
        return self._store.types[kind](**fields)

    def _header(self, stamp_ns: int, frame: str) -> Any:
        seconds, nanoseconds = divmod(stamp_ns, 10**9)
        stamp = self._make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def _compressed(self, data: bytes, layout: str, stamp_ns: int, frame: str) -> Any:
        return self._make(
            "sensor_msgs/msg/CompressedImage",
            header=self._header(stamp_ns, frame),
            format=layout,
            data=np.frombuffer(data, np.uint8),
        )

    def _transform(self, matrix: F64) -> Any:
        return self._make(
            "geometry_msgs/msg/Transform",
            translation=self._vector("Vector3", matrix[:3, 3]),
            rotation=self._quaternion(matrix[:3, :3]),
        )

    def _quaternion(self, rotation: F64) -> Any:
        x, y, z, w = Rotation.from_matrix(rotation).as_quat().tolist()
        return self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _vector(self, kind: str, values: npt.ArrayLike) -> Any:
        x, y, z = np.asarray(values, np.float64).tolist()
        return self._make(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)


def _tags(**numbers: float | None) -> dict[str, str]:
    """Format the known numbers exactly."""
    return {name: repr(float(value)) for name, value in numbers.items() if value is not None}
