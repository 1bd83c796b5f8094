"""Readers of network data: messages, people in CDR, images."""

import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from common.geometry.wheel_odometry import WheelConfig
from common.io.images import decode_jpeg, decode_png16, decompress, encode_jpeg, encode_png16
from common.io.ros_bag import PEOPLE, make_typestore
from common.ros2 import types as ros2_types
from common.ros2.transforms import edges_of
from people4d.codec import MESSAGES, decode, encode
from people4d.errors import DecodeError
from people4d.messages import CompressedRgbdFrame, Detections, Message
from services.camera.config import MotionConfig
from services.camera.ros.camera_info import intrinsics_of
from services.camera.ros.images import colour_image, depth_image
from services.camera.ros.live_motion import LiveMotion
from services.camera.ros.motion import FrameTree, odometry_of
from services.camera.ros.topics import RGBD
from services.gt_bridge.sources.ros import stamped_truth, truth_of
from tests.camera.ros.bags import Ros, compressed_depth, depth_mm, rgb
from tests.contract.examples import FULL, SPARSE
from tests.fuzz.target import Target

WORDS = (b"\xa5dtype", b"\xa5shape", b"\xa4data", b"\xa7float64", b"\xa7float32", b"\xa5uint8")


def _either(decoder: Callable[[Any], object], message: Any) -> None:
    """Decode an image with each decoder, whatever its format."""
    with contextlib.suppress(DecodeError):
        decoder(message)


def _image(message: Any) -> None:
    _either(colour_image, message)
    _either(depth_image, message)


def _tree(message: Any) -> None:
    tree = FrameTree()
    for edge in edges_of(message):
        tree.add_transform(edge.parent, edge.child, edge.matrix)
    tree.find_transform("map", "camera_color_optical_frame")


# Types that are read from ROS, and what becomes of them; the first byte of an input chooses.
READERS: dict[str, Callable[[Any], object]] = {
    "sensor_msgs/msg/Image": _image,
    "sensor_msgs/msg/CompressedImage": _image,
    "sensor_msgs/msg/CameraInfo": lambda m: (intrinsics_of(m), intrinsics_of(m, "/a/image_rect")),
    "nav_msgs/msg/Odometry": lambda m: odometry_of(m, 0, 0),
    "tf2_msgs/msg/TFMessage": _tree,
    RGBD: lambda m: (colour_image(m.rgb), depth_image(m.depth)),
}
STORE = make_typestore(2, {})


def message_target(name: str) -> Target:
    """Return the target of one type of message."""
    return Target(
        name=f"message {name}",
        read=_message,
        seeds=lambda _: [encode(m) for m in (*FULL, *SPARSE) if type(m).__name__ == name],
        words=[*WORDS, *(field.encode() for field in MESSAGES[name].__struct_fields__)],
    )


def _message(data: bytes, _: Path) -> None:
    """Decode; a valid message survives a round trip and can be used."""
    message = decode(data)
    again = encode(message)
    if encode(decode(again)) != again:
        raise AssertionError("a message changes in a round trip")
    _use(message)


def _use(message: Message) -> None:
    if isinstance(message, CompressedRgbdFrame):
        decompress(message)
    if isinstance(message, Detections):
        for detection in message.detections:
            if detection.mask:
                detection.mask.window()


def _ros(data: bytes, _: Path) -> None:
    kinds = list(READERS)
    kind = kinds[data[0] % len(kinds)] if data else kinds[0]
    try:
        message: Any = STORE.deserialize_cdr(data[1:], kind)
    except Exception:  # as Bag.messages counts it
        return
    READERS[kind](message)


def _ros_seeds(_: Path) -> Sequence[bytes]:
    ros = Ros(2)
    header = ros.header(10**9)
    rgbd = ros.make(
        RGBD,
        header=header,
        rgb_camera_info=ros.camera_info(),
        depth_camera_info=ros.camera_info(),
        rgb=ros.image(rgb(), "rgb8"),
        depth=ros.image(depth_mm(), "16UC1"),
    )
    depth_m = np.full((2, 3), 1.5, np.float32)
    seeds = [
        ("sensor_msgs/msg/Image", ros.image(rgb(), "bgr8", padding=2)),
        ("sensor_msgs/msg/Image", ros.image(depth_mm(), "16UC1")),
        ("sensor_msgs/msg/Image", ros.image(depth_m, "32FC1")),
        ("sensor_msgs/msg/CompressedImage", ros.compressed(encode_jpeg(rgb()), "jpeg")),
        (
            "sensor_msgs/msg/CompressedImage",
            ros.compressed(compressed_depth(depth_mm(), 1.0, 2.0), "32FC1; compressedDepth png"),
        ),
        (
            "sensor_msgs/msg/CompressedImage",
            ros.compressed(bytes(12) + b'\3\0\0\0\2\0\0\0\0"\xa1"', "16UC1; compressedDepth rvl"),
        ),
        ("sensor_msgs/msg/CameraInfo", ros.camera_info(distortion=(0.1, 0, 0, 0, 0))),
        ("nav_msgs/msg/Odometry", ros.odometry(1.0, 2.0, 3.0, 5)),
        ("tf2_msgs/msg/TFMessage", ros.transform("map", "base", (1, 2, 3), (0, 0, 0, 1))),
        (RGBD, rgbd),
    ]
    kinds = list(READERS)
    return [
        bytes([kinds.index(kind)]) + bytes(STORE.serialize_cdr(message, kind))
        for kind, message in seeds
    ]


def _motion(data: bytes, _: Path) -> None:
    """Decode motion of a robot and convert it like the camera."""
    motion = MOTIONS[data[0] % len(MOTIONS) if data else 0]
    topic = motion.topics[data[1] % len(motion.topics) if len(data) > 1 else 0]
    for message in motion.convert(topic.decode(data[2:]), ("base", "camera")):
        encode(message)


def _motion_seeds(_: Path) -> Sequence[bytes]:
    ros = Ros(2)
    header = ros.header(10**9)
    joints = ros.make(
        "sensor_msgs/msg/JointState",
        header=header,
        name=["left", "right"],
        position=np.array([1.0, 2.0]),
    )
    transform = ros.transform("map", "base", (1, 2, 3), (0, 0, 0, 1), 10**9)
    seeds = [
        (b"\0\0", "nav_msgs/msg/Odometry", ros.odometry(1.0, 2.0, 3.0, 10**9)),
        (b"\0\1", "tf2_msgs/msg/TFMessage", transform),
        (b"\0\2", "tf2_msgs/msg/TFMessage", transform),
        (b"\1\0", "sensor_msgs/msg/JointState", joints),
    ]
    return [
        chosen + bytes(ros.store.serialize_cdr(message, kind)) for chosen, kind, message in seeds
    ]


def _jpeg(data: bytes, _: Path) -> None:
    decode_jpeg(data)


def _png(data: bytes, _: Path) -> None:
    decode_png16(data)


def _people(data: bytes, _: Path) -> None:
    stamped_truth(ros2_types.decode(PEOPLE, data))


def _people_seeds(_: Path) -> Sequence[bytes]:
    store, types = STORE, STORE.types
    point, stamp = types["geometry_msgs/msg/Point"], types["builtin_interfaces/msg/Time"]
    person = types["people_msgs/msg/Person"](
        name="anna",
        position=point(x=1.0, y=2.0, z=3.0),
        velocity=point(x=0.5, y=0.0, z=0.0),
        reliability=1.0,
        tagnames=["yaw_rad", "other"],
        tags=["0.25", "x"],
    )
    header = types["std_msgs/msg/Header"](stamp=stamp(sec=5, nanosec=7), frame_id="/map")
    truths = [types[PEOPLE](header=header, people=[person] * count) for count in (0, 1, 3)]
    assert truth_of(truths[1], 0).people
    return [bytes(store.serialize_cdr(truth, PEOPLE)) for truth in truths]


TREES = ("zenoh:tf", "zenoh:tf_static")
MOTIONS = tuple(
    LiveMotion(config)
    for config in (
        MotionConfig(odometry="zenoh:odom", transforms=TREES),
        MotionConfig(joints="zenoh:joints", wheels=WheelConfig(joints=("left", "right"))),
    )
)

TARGETS = (
    *(message_target(name) for name in MESSAGES),
    Target("CDR images and calibration", _ros, _ros_seeds, (b"rgb8", b"16UC1", b"32FC1", b"png")),
    Target("CDR of motion", _motion, _motion_seeds, (b"base", b"camera", b"left", b"right")),
    Target("CDR people", _people, _people_seeds, (b"yaw_rad", b"path_yaw_rad", b"nan", b"1e999")),
    Target("JPEG", _jpeg, lambda _: [encode_jpeg(rgb())]),
    Target(
        "PNG depth",
        _png,
        lambda _: [encode_png16(depth_mm()), encode_png16(depth_mm(), smooth=True)],
        (b"zTXt", b"acTL", b"iCCP", b"PLTE", b"tRNS"),
    ),
)
