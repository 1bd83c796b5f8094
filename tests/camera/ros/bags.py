"""Small ROS bags, written with the ROS types of their distribution."""

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from common.io.ros_bag import make_typestore
from services.camera.ros.topics import DEFINITIONS

COLOUR, DEPTH = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"
INFO, ODOMETRY, TF = "/camera/color/camera_info", "/odom", "/tf_static"
FRAME = "camera_color_optical_frame"
SIZE = (6, 8)  # height and width of the images

Entry = tuple[str, int, Any]  # topic, time in nanoseconds, message


class Ros:
    """Makes messages of ROS 1 or ROS 2 and writes them to a bag."""

    def __init__(self, version: int) -> None:
        self.version = version
        self.store = make_typestore(version, DEFINITIONS)

    def make(self, kind: str, **fields: Any) -> Any:
        """Make a message; fields left out are zero, and messages inside may be mappings."""
        values = {
            name: fields[name] if name in fields else self._zero(node, detail)
            for name, (node, detail) in self.store.fielddefs[kind][1]
        }
        for name, (node, detail) in self.store.fielddefs[kind][1]:
            if node is Nodetype.NAME and isinstance(values[name], Mapping):
                values[name] = self.make(str(detail), **values[name])
        return self.store.types[kind](**values)

    def _zero(self, node: Nodetype, detail: Any) -> Any:
        """Return the value of a field that is left out."""
        if node is Nodetype.NAME:
            return {}
        if node is Nodetype.BASE:
            return "" if detail[0] == "string" else 0
        (inner, (name, *_)), size = detail
        if inner is Nodetype.BASE and name != "string":
            return np.zeros(size if node is Nodetype.ARRAY else 0, name)
        return []

    def header(self, stamp_ns: int, frame: str = FRAME) -> Any:
        stamp = {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def image(
        self,
        pixels: npt.NDArray[Any],
        encoding: str,
        stamp_ns: int = 0,
        padding: int = 0,
        frame: str = FRAME,
    ) -> Any:
        """Make an Image; big-endian if the pixels are, each row followed by padding bytes."""
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
        rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=170)
        return self.make(
            "sensor_msgs/msg/Image",
            header=self.header(stamp_ns, frame),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=int(pixels.dtype.byteorder == ">"),
            step=rows.shape[1],
            data=rows.reshape(-1),
        )

    def compressed(self, data: bytes, layout: str, stamp_ns: int = 0) -> Any:
        return self.make(
            "sensor_msgs/msg/CompressedImage",
            header=self.header(stamp_ns),
            format=layout,
            data=np.frombuffer(data, np.uint8),
        )

    def camera_info(
        self,
        fx: float = 10.0,
        distortion: Sequence[float] = (),
        model: str = "plumb_bob",
        frame: str = FRAME,
    ) -> Any:
        height, width = SIZE
        matrix = np.array([fx, 0, width / 2, 0, fx, height / 2, 0, 0, 1.0])
        upper = {
            "d": np.array(distortion, np.float64),
            "k": matrix,
            "r": np.eye(3).ravel(),
            "p": np.zeros(12),
        }
        names = {name.upper(): value for name, value in upper.items()}
        return self.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(0, frame),
            height=height,
            width=width,
            distortion_model=model,
            **(names if self.version == 1 else upper),
        )

    def transform(
        self,
        parent: str,
        child: str,
        xyz: Sequence[float],
        xyzw: Sequence[float],
        stamp_ns: int = 0,
    ) -> Any:
        item = self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(stamp_ns, parent),
            child_frame_id=child,
            transform={
                "translation": dict(zip("xyz", xyz, strict=True)),
                "rotation": dict(zip("xyzw", xyzw, strict=True)),
            },
        )
        return self.make("tf2_msgs/msg/TFMessage", transforms=[item])

    def odometry(self, x: float, y: float, yaw_rad: float, stamp_ns: int) -> Any:
        covariance = np.zeros((6, 6))
        covariance[[0, 1, 5], [0, 1, 5]] = 0.1, 0.2, 0.3
        turn = {"z": float(np.sin(yaw_rad / 2)), "w": float(np.cos(yaw_rad / 2))}
        return self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(stamp_ns, "odom"),
            child_frame_id="base_link",
            pose={
                "pose": {"position": {"x": x, "y": y}, "orientation": turn},
                "covariance": covariance.ravel(),
            },
            twist={"twist": {"linear": {"x": 0.5}, "angular": {"z": 0.25}}},
        )

    def write(self, path: Path, entries: Sequence[Entry]) -> Path:
        """Write a bag: one file for ROS 1, else a folder; its storage is MCAP if named so."""
        storage = StoragePlugin.MCAP if "mcap" in path.name else StoragePlugin.SQLITE3
        bag: Any = (
            Writer1(path) if self.version == 1 else Writer2(path, version=9, storage_plugin=storage)
        )
        pack = self.store.serialize_ros1 if self.version == 1 else self.store.serialize_cdr
        with bag as writer:
            links = {
                topic: writer.add_connection(topic, kind, typestore=self.store)
                for topic, kind in {t: message.__msgtype__ for t, _, message in entries}.items()
            }
            for topic, time_ns, message in entries:
                data = pack(message, message.__msgtype__)
                writer.write(links[topic], time_ns, bytes(data))
        return path


def rgb(value: int = 0) -> npt.NDArray[np.uint8]:
    """An image whose red is `value`, green the column and blue the row."""
    image = np.zeros((*SIZE, 3), np.uint8)
    image[..., 0] = value
    image[..., 1] = np.arange(SIZE[1])
    image[..., 2] = np.arange(SIZE[0])[:, None]
    return image


def depth_mm(value: int = 1000) -> npt.NDArray[np.uint16]:
    """A plane with a hole in its first pixel."""
    depth = np.full(SIZE, value, np.uint16)
    depth[0, 0] = 0
    return depth


def frames(ros: Ros, count: int = 3, shift_ns: int = 4_000_000) -> list[Entry]:
    """Colour at 0, 100, 200 ms after 1 s, depth each time later by a shift."""
    entries: list[Entry] = [(INFO, 10**9, ros.camera_info(distortion=(0.1, 0, 0, 0, 0)))]
    for k in range(count):
        stamp_ns = 10**9 + k * 10**8
        colour = ros.image(rgb(k), "rgb8", stamp_ns)
        depth = ros.image(depth_mm(1000 + k), "16UC1", stamp_ns + shift_ns)
        entries.append((COLOUR, stamp_ns, colour))
        entries.append((DEPTH, stamp_ns + shift_ns, depth))
    return entries


def compressed_depth(inverse: npt.NDArray[np.uint16], a: float, b: float) -> bytes:
    """PNG with the header of compressed_depth_image_transport."""
    _, png = cv2.imencode(".png", inverse)
    return struct.pack("<iff", 0, a, b) + png.tobytes()
