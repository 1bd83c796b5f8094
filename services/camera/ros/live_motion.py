"""Live motion of the robot from its ROS 2: odometry, wheels and transforms in CDR."""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, TypeVar

import msgspec

from common.ros2 import types
from common.ros2.frame_names import frame_name
from common.ros2.transforms import StampedTransform, edges_of, stamp_of
from people4d.errors import ConfigError, DecodeError
from people4d.messages import Message, MovingTransform, Odometry, StaticTransform
from people4d.topics import ForeignTopic
from services.camera.calibration import static_transform
from services.camera.config import MotionConfig
from services.camera.ros.motion import FrameTree, WheelReader, odometry_of
from services.camera.ros.topics import JOINTS, ODOMETRY, TF

T = TypeVar("T")

SCHEME = "zenoh:"
# Chunks of characters in names of ROS topics
KEY = re.compile(r"[A-Za-z0-9_~.%@-]{1,64}(/[A-Za-z0-9_~.%@-]{1,64}){0,31}")
COUNTERS = ("moving_transforms", "live_odometry", "bad_transforms", "other_transforms")


class TransformMessage(Message, frozen=True, kw_only=True):
    """A tf2_msgs/TFMessage, inside this process only."""

    transforms: tuple[StampedTransform, ...]
    static: bool


class LiveMotion:
    """Topics of ROS 2 with the motion of the camera; ConfigError if a key is invalid.

    Only transforms between the camera and the root of its tree are published. The transform of the
    base in its odometry frame is published only without odometry.
    """

    def __init__(self, config: MotionConfig) -> None:
        self.counters = Counter(dict.fromkeys(COUNTERS, 0))
        self._offset_ns = round(config.offset_s * 1e9)
        self._tree = FrameTree()
        self._base: tuple[str, str] | None = None  # frames of odometry
        self._received = set[type[Message]]()
        self.topics: Sequence[ForeignTopic] = tuple(_topics(config))

    @property
    def silent(self) -> list[str]:
        """Keys without a message so far."""
        return [topic.key for topic in self.topics if topic.message not in self._received]

    def convert(self, message: Message, parents: Sequence[str]) -> list[Message]:
        """Convert a message of these topics to messages of people4d.

        `parents` are the frame of the camera and the parents of its transforms.
        """
        self._received.add(type(message))
        if isinstance(message, TransformMessage):
            return self._transforms(message, parents)
        if not isinstance(message, Odometry):
            return []
        self._base = message.frame_id, message.child_frame_id
        stamp_ns, sequence = message.stamp_ns + self._offset_ns, self.counters["live_odometry"]
        self.counters["live_odometry"] += 1
        return [msgspec.structs.replace(message, stamp_ns=stamp_ns, sequence=sequence)]

    def _transforms(self, message: TransformMessage, parents: Sequence[str]) -> list[Message]:
        for edge in message.transforms:
            self._tree.add_transform(frame_name(edge.parent), frame_name(edge.child))
        chain = {*parents, *(parent for frame in parents for parent, *_ in self._tree.path(frame))}
        converted: list[Message] = []
        for edge in message.transforms:
            names = frame_name(edge.parent), frame_name(edge.child)
            if names[1] not in chain or names == self._base:
                self.counters["other_transforms"] += 1
                continue
            try:
                converted.append(self._transform(edge, message.static))
            except DecodeError:
                self.counters["bad_transforms"] += 1
        return converted

    def _transform(self, edge: StampedTransform, static: bool) -> StaticTransform | MovingTransform:
        if static:
            return static_transform(edge.parent, edge.child, edge.matrix)
        if edge.stamp_ns == 0:
            raise DecodeError("transform: expected a time in header.stamp, got 0")
        sequence = self.counters["moving_transforms"]
        moving = edge.moving(edge.stamp_ns + self._offset_ns, sequence)
        self.counters["moving_transforms"] += 1
        return moving


def _topics(config: MotionConfig) -> Iterator[ForeignTopic]:
    wheels = WheelReader(config.wheels)
    readers: list[tuple[str, str, str, Callable[[Any], Odometry]]] = [
        ("odometry", config.odometry, ODOMETRY, lambda m: odometry_of(m, _stamp_ns(m), 0)),
        ("joints", config.joints, JOINTS, lambda m: wheels.joints(m, _stamp_ns(m))),
    ]
    for name, text, kind, read in readers:
        if text:
            key, decode = _parse_key(f"motion.{name}", text, "odom"), partial(_decode, kind, read)
            yield ForeignTopic(f"live_{name}", key, Odometry, 50, "queue", 256, "ROS", decode)
    for number, text in enumerate(config.transforms):
        key = _parse_key("motion.transforms", text, "tf")
        edges = partial(_decode, TF, partial(_transform_message, key.endswith("tf_static")))
        name = f"live_transforms{number or ''}"
        yield ForeignTopic(name, key, TransformMessage, 100, "queue", 256, "ROS", edges)


def _parse_key(field: str, text: str, example: str) -> str:
    """Return the key in "zenoh:KEY", named like the ROS topic /KEY, or raise ConfigError."""
    key = text.removeprefix(SCHEME).strip("/")
    if not KEY.fullmatch(key):
        raise ConfigError(
            f"{field} {text!r:.80} is not a key",
            f"Write zenoh: and the ROS topic, for example {SCHEME}{example}.",
        )
    return key


def _decode(kind: str, read: Callable[[Any], T], payload: bytes) -> T:
    return read(types.decode(kind, payload))


def _transform_message(static: bool, message: Any) -> TransformMessage:
    edges = tuple(edge for edge in edges_of(message) if edge.parent and edge.child)
    return TransformMessage(stamp_ns=0, sequence=0, transforms=edges, static=static)


def _stamp_ns(message: Any) -> int:
    stamp_ns = stamp_of(message)
    if stamp_ns == 0:
        raise DecodeError("odometry: expected its time in header.stamp, got 0")
    return stamp_ns
