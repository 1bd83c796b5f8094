"""Table of topics, from which subscriptions, recorder, documentation and access rules derive."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import msgspec

from people4d.messages import (
    AreaPeople,
    CameraInfo,
    CompressedRgbdFrame,
    Crops,
    Detections,
    Embeddings,
    Event,
    Gait,
    Health,
    ImageTracks,
    Message,
    MovingTransform,
    Odometry,
    Predictions,
    RgbdFrame,
    Score,
    Skeletons,
    StaticTransform,
    Target,
    TargetCommand,
    Tracks,
    Truth,
    ZoneEdit,
    Zones,
)

VERSION = "v1"
EVERY_SERVICE = "every service"
LOCKSTEP_MAX = 8  # maximum number of frames in flight in lock-step
IMAGE_MAX_BYTES = 64 * 2**20  # maximum size of a message with images
OTHER_MAX_BYTES = 16 * 2**20  # maximum size of another message
# Maximum number of keys of a topic, a bound against invented names; transforms have a key for each
# frame, about 100 on a humanoid robot
KEYS_MAX, TRANSFORMS_MAX = 256, 512


@dataclass(frozen=True)
class Topic:
    """A topic: its key, its messages, their delivery, and roles."""

    name: str  # name on the command line and in the documentation
    key: str  # key below people4d/v1/<robot>/; names in braces are fields of the message
    message: type[Message]  # type of its messages
    rate_hz: float  # expected rate of one publisher; 0 if sent once
    # "newest": the newest message replaces older ones, which are counted; "queue": queued in order
    # up to depth; "latched": sent once, a late subscriber gets the last message
    delivery: Literal["newest", "queue", "latched"]
    # length of a subscriber's queue; for "newest" only of lossless messages (lock-step)
    depth: int
    # publishing services, separated by spaces; with restricted access no other role may publish
    producer: str
    # roles that may read it with restricted access, separated by spaces: services, "planner" and
    # "operator" (the command line); "*": all roles. See common/transport/access.py
    readers: str = field(default="", kw_only=True)
    # True: messages have a lasting effect, so only its producers may send them, see
    # people4d/ownership.py
    owned: bool = field(default=False, kw_only=True)
    # True: it may leave its host with restricted access
    leaves_host: bool = field(default=True, kw_only=True)
    # field and value of messages that must not be skipped or dropped; None: no such messages
    lossless: tuple[str, Any] | None = field(default=None, kw_only=True)
    # scope of a sequence without gaps: "key", or a field of the message; empty: gaps mean nothing
    numbered: str = field(default="", kw_only=True)
    # True: its publisher waits for a slow link if messages are queued; False: it drops them
    waits: bool = field(default=True, kw_only=True)
    # maximum size of a message [bytes]; longer ones are dropped unread
    max_bytes: int = field(default=OTHER_MAX_BYTES, kw_only=True)
    # maximum number of keys; messages on more keys are dropped unread
    keys_max: int = field(default=KEYS_MAX, kw_only=True)
    # True: `clock_of` is the message's camera; False: the robot's clock
    camera_clock: bool = field(default=False, kw_only=True)

    @property
    def producers(self) -> frozenset[str]:
        """Publishing services."""
        one = self.producer == EVERY_SERVICE
        return frozenset([self.producer] if one else self.producer.split())

    def clock_of(self, message: Message) -> str:
        """Return the camera whose clock stamps a message; empty: the robot's clock."""
        return str(message.camera) if self.camera_clock else ""  # type: ignore[attr-defined]

    def is_lossless(self, message: msgspec.Struct) -> bool:
        """Check that a message, or a record of its first fields, must not be skipped or dropped."""
        return self.lossless is not None and getattr(message, self.lossless[0]) == self.lossless[1]

    def may_be_replaced(self, message: msgspec.Struct) -> bool:
        """Check that a newer message replaces a waiting one."""
        return self.delivery == "newest" and not self.is_lossless(message)

    def key_of(self, message: Message, robot: str) -> str:
        """Return the full key of a message."""
        return f"{prefix(robot)}/{self.key.format_map(_Fields(message))}"

    def key_expression(self, robot: str) -> str:
        """Return the key expression that covers all keys of this topic."""
        return f"{prefix(robot)}/{re.sub(r'{[^}]*}', '*', self.key)}"


@dataclass(frozen=True)
class ForeignTopic(Topic):
    """A topic of another system: its key has no prefix, its payloads are decoded by a function.

    A node lists its foreign topics in `foreign_inputs` and receives `message`.
    """

    decode: Callable[[bytes], Message]  # decodes untrusted bytes; raises DecodeError

    def key_expression(self, robot: str) -> str:  # noqa: ARG002
        """Return the key, which has no robot's prefix."""
        return self.key


class _Fields(dict[str, str]):
    """Fields of a message by name, for str.format_map."""

    def __init__(self, message: Message) -> None:
        super().__init__()
        self.message = message

    def __missing__(self, name: str) -> str:
        return str(getattr(self.message, name))


# fmt: off
TOPICS: tuple[Topic, ...] = (
    Topic("frames", "raw/{camera}/rgbd", RgbdFrame, 30, "newest", 32, "camera",
          readers="dashboard detector gait visual_odometry report operator", leaves_host=False,
          lossless=("lockstep", True), numbered="key", max_bytes=IMAGE_MAX_BYTES),
    Topic("compressed", "raw/{camera}/compressed", CompressedRgbdFrame, 30, "newest", 32, "camera",
          readers="dashboard detector report operator", numbered="key", max_bytes=IMAGE_MAX_BYTES),
    Topic("camera_info", "camera/{camera}/info", CameraInfo, 0, "latched", 8, "camera",
          readers="dashboard detector tracker skeleton gait visual_odometry gt_bridge report "
                  "planner operator", owned=True),
    Topic("static_transforms", "transforms/{child}", StaticTransform, 0, "latched", 32, "camera",
          readers="dashboard events tracker skeleton gait visual_odometry gt_bridge predictor "
                  "ros2_bridge report target planner operator", owned=True,
          keys_max=TRANSFORMS_MAX),
    Topic("moving_transforms", "moving/{child}", MovingTransform, 50, "queue", 256,
          "camera visual_odometry",
          readers="dashboard events tracker skeleton gait gt_bridge predictor ros2_bridge report "
                  "target operator", owned=True, keys_max=TRANSFORMS_MAX),
    Topic("odometry", "odometry", Odometry, 50, "queue", 256, "camera visual_odometry",
          readers="dashboard events tracker skeleton gait visual_odometry gt_bridge predictor "
                  "ros2_bridge report target operator", owned=True),
    Topic("detections", "detections/{camera}", Detections, 30, "queue", 64, "detector",
          readers="dashboard camera detector tracker skeleton gait visual_odometry gt_bridge "
                  "ros2_bridge report target operator", camera_clock=True),
    Topic("crops", "raw/{camera}/crops", Crops, 30, "queue", 8, "detector",
          readers="reid operator", leaves_host=False, max_bytes=IMAGE_MAX_BYTES),
    Topic("embeddings", "embeddings/{camera}", Embeddings, 30, "queue", 64, "reid",
          readers="reid tracker target operator"),
    Topic("people", "people", Tracks, 30, "queue", 64, "tracker site",
          readers="dashboard events camera tracker skeleton gait gt_bridge predictor ros2_bridge "
                  "report site target planner operator", numbered="camera", camera_clock=True),
    Topic("area_people", "area_people", AreaPeople, 4, "queue", 16, "tracker",
          readers="tracker operator"),
    Topic("gait", "gait", Gait, 30, "queue", 64, "gait",
          readers="report planner operator"),
    Topic("predictions", "predictions", Predictions, 10, "queue", 64, "predictor",
          readers="dashboard ros2_bridge report target planner operator", camera_clock=True),
    Topic("skeletons", "skeletons", Skeletons, 30, "queue", 64, "skeleton",
          readers="dashboard events ros2_bridge report target planner operator"),
    Topic("events", "events", Event, 1, "queue", 256, "events",
          readers="dashboard ros2_bridge planner operator"),
    Topic("zones", "zones", Zones, 0, "latched", 8, "events",
          readers="dashboard planner operator", owned=True),
    Topic("zone_edits", "zone_edits", ZoneEdit, 1, "queue", 8, "dashboard",
          readers="events operator"),
    Topic("target", "target", Target, 30, "queue", 64, "target",
          readers="dashboard ros2_bridge planner operator"),
    Topic("target_commands", "target_commands", TargetCommand, 1, "queue", 8,
          "dashboard ros2_bridge planner operator", readers="target operator"),
    Topic("boxes", "boxes/{camera}", ImageTracks, 30, "queue", 64, "tracker",
          readers="planner operator"),
    Topic("truth", "truth", Truth, 100, "queue", 256, "gt_bridge",
          readers="report operator", owned=True),
    Topic("score", "score", Score, 30, "queue", 256, "gt_bridge",
          readers="report operator"),
    Topic("health", "health/{service}/{instance}", Health, 2, "queue", 256, EVERY_SERVICE,
          readers="*", lossless=("state", "stopping"), waits=False),
)
# fmt: on

BY_MESSAGE: dict[type[Message], Topic] = {topic.message: topic for topic in TOPICS}
BY_NAME: dict[str, Topic] = {topic.name: topic for topic in TOPICS}


def prefix(robot: str) -> str:
    """Return the key prefix of one robot."""
    return f"people4d/{VERSION}/{robot}"


def query_key(robot: str, name: str) -> str:
    """Return the full key of a query between processes."""
    return f"{prefix(robot)}/queries/{name}"


def topic_of_key(key: str, robot: str = "*") -> Topic | None:
    """Return the topic of a full key, None if there is none.

    Args:
        key: Full key, for example people4d/v1/robot/people.
        robot: Name of the robot of the key, "*" for any.
    """
    for topic in TOPICS:
        pattern = re.escape(topic.key_expression(robot)).replace(r"\*", "[^/]+")
        if re.fullmatch(pattern, key):
            return topic
    return None
