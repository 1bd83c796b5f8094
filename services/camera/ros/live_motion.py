"""Live motion of the robot from its ROS 2: odometry, wheels and transforms in CDR."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import msgspec

from common.io.ros_cdr import CdrDecoder, parse_key
from people4d.errors import DecodeError
from people4d.messages import Message, MovingTransform, Odometry, StaticTransform
from people4d.topics import ForeignTopic
from services.camera.calibration import frame_name, static_transform
from services.camera.config import MotionConfig
from services.camera.ros.motion import (
    FrameParents,
    StampedTransform,
    WheelReader,
    edges_of,
    odometry_of,
)
from services.camera.ros.types import JOINTS, ODOMETRY, TF, ros2_types

COUNTERS = ("moving_transforms", "live_odometry", "bad_transforms", "other_transforms")


class TransformMessage(Message, frozen=True, kw_only=True):
    """One tf2_msgs/TFMessage; it never leaves this process."""

    transforms: tuple[StampedTransform, ...]
    static: bool


class LiveMotion:
    """Topics of ROS 2 from which the motion of the camera follows.

    Only transforms between the camera and the root of its tree are passed on, and the one between
    the base and the frame of its odometry only without odometry.

    Args:
        config: The topics.

    Raises:
        ConfigError: A key is not one.
    """

    def __init__(self, config: MotionConfig) -> None:
        self.counters = Counter(dict.fromkeys(COUNTERS, 0))
        self._config = config
        self._parents = FrameParents()
        self._base: tuple[str, str] | None = None  # frames of odometry
        self._received = set[type[Message]]()
        self._wheels = WheelReader(config.wheels)
        self.topics: Sequence[ForeignTopic] = tuple(self._topics())

    def _topics(self) -> Sequence[ForeignTopic]:
        config, store = self._config, ros2_types()
        topics = []
        for name, kind, read in (
            ("odometry", ODOMETRY, self._odometry),
            ("joints", JOINTS, self._joints),
        ):
            text = getattr(config, name)
            if text:
                decode = CdrDecoder(name, store, kind, read).decode
                key = parse_key(f"motion.{name}", text, "odom")
                topics.append(
                    ForeignTopic(f"live_{name}", key, Odometry, 50, "queue", 256, "ROS", decode)
                )
        for number, text in enumerate(config.transforms):
            key = parse_key("motion.transforms", text, "tf")
            read_ = _static if key.endswith("tf_static") else _moving
            decode_ = CdrDecoder("transforms", store, TF, read_).decode
            topic = f"live_transforms{number or ''}"
            topics.append(
                ForeignTopic(topic, key, TransformMessage, 100, "queue", 256, "ROS", decode_)
            )
        return topics

    @property
    def silent(self) -> list[str]:
        """Keys without a message so far."""
        return [topic.key for topic in self.topics if topic.message not in self._received]

    def convert(self, message: Message, parents: Sequence[str]) -> list[Message]:
        """Return the messages of ours that follow from a message of these topics.

        Args:
            message: As decoded.
            parents: Frame of the camera, and those that its transforms lead to.
        """
        self._received.add(type(message))
        if isinstance(message, Odometry):
            self._base = message.frame_id, message.child_frame_id
            self.counters["live_odometry"] += 1
            return [
                msgspec.structs.replace(
                    message,
                    stamp_ns=self._shifted(message.stamp_ns),
                    sequence=self.counters["live_odometry"] - 1,
                )
            ]
        if not isinstance(message, TransformMessage):
            return []
        for edge in message.transforms:
            self._parents.add(frame_name(edge.parent), frame_name(edge.child))
        ancestors = {name for frame in parents for name in self._parents.ancestors(frame)}
        converted: list[Message] = []
        for edge in message.transforms:
            names = frame_name(edge.parent), frame_name(edge.child)
            if names[1] not in ancestors or names == self._base:
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
        moving = edge.moving(
            self._shifted(edge.stamp_ns), sequence=self.counters["moving_transforms"]
        )
        self.counters["moving_transforms"] += 1
        return moving

    def _shifted(self, stamp_ns: int) -> int:
        return stamp_ns + round(self._config.offset_s * 1e9)

    def _odometry(self, message: Any) -> Odometry:
        return odometry_of(message, _stamp_ns(message), 0)

    def _joints(self, message: Any) -> Odometry:
        return self._wheels.joints(message, _stamp_ns(message))


def _static(message: Any) -> TransformMessage:
    return TransformMessage(stamp_ns=0, sequence=0, transforms=_edges(message), static=True)


def _moving(message: Any) -> TransformMessage:
    return TransformMessage(stamp_ns=0, sequence=0, transforms=_edges(message), static=False)


def _edges(message: Any) -> tuple[StampedTransform, ...]:
    return tuple(edge for edge in edges_of(message) if edge.parent and edge.child)


def _stamp_ns(message: Any) -> int:
    stamp_ns = int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)
    if stamp_ns == 0:
        raise DecodeError("odometry: expected its time in header.stamp, got 0")
    return stamp_ns
