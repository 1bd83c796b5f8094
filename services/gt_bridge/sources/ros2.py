"""Live truth from topics of ROS 2: people_msgs/People, or one PoseStamped for each person."""

import math
import re
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import msgspec
import numpy as np

from common.ros2 import types
from common.ros2.transport import SENSOR_DATA, Qos, Ros2Sample, Ros2Transport
from common.ros2.transports import TRANSPORTS, open_transport
from common.text import listed
from people4d.errors import ConfigError, DecodeError
from people4d.messages import Truth, TruthPerson
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.sources.ros import stamped_truth

SOURCE = re.compile(r"ros2(\+(?P<transport>\w+))?:(?P<topics>/[^,]+(,/[^,]+)*)")
POSE = "geometry_msgs/msg/PoseStamped"
PEOPLE = "people_msgs/msg/People"
QUEUE = Qos(SENSOR_DATA.reliability, SENSOR_DATA.durability, 100)
WAITING_MAX = 256  # maximum number of waiting messages
SHOWN = 4  # maximum number of topics in a reason
TOGETHER_S = 0.05  # maximum time between the arrivals of the poses of one capture [s]


class Ros2Truth:
    """Receives truth, and joins poses of one stamp to one message.

    A topic named .../PERSON/pose has poses of PERSON, other topics have People. ConfigError if the
    source does not name topics of ROS 2.
    """

    def __init__(self, config: GtBridgeConfig) -> None:
        match = SOURCE.fullmatch(config.truth)
        transport: Any = (match["transport"] if match else None) or "zenoh"
        if not match or transport not in TRANSPORTS:
            raise ConfigError(
                f"truth {config.truth!r:.80} names no topics of ROS 2",
                f"Write ros2:/vicon/people, or ros2+ and one of {', '.join(TRANSPORTS)}.",
            )
        self._topics = tuple(match["topics"].split(","))
        self._config = msgspec.structs.replace(config.ros2, transport=transport)
        self._transport: Ros2Transport | None = None
        self._lock = threading.Lock()
        self._ready: deque[Truth] = deque()
        # stamp, frame and person by topic
        self._poses: dict[str, tuple[int, str, TruthPerson]] = {}
        self._since_s = 0.0
        self._late = Counter[str](late_poses=0, skipped_truth=0)
        self._silent = dict.fromkeys(self._topics)  # topics without a message so far
        self._wake: Callable[[], None] = lambda: None

    def __iter__(self) -> Iterator[Truth]:
        """Yield nothing: live truth comes as messages."""
        return iter(())

    @property
    def counters(self) -> Counter[str]:
        """Dropped messages by cause, and the number of topics without a message."""
        transport = self._transport.counters if self._transport else Counter[str]()
        return Counter(**self._late, **transport, absent_topics=len(self._silent))

    @property
    def problem(self) -> str:
        """Topics without a message so far, empty if there are none."""
        silent = list(self._silent)
        return f"no messages on {listed(silent, SHOWN)}" if silent else ""

    def start(self, wake: Callable[[], None]) -> None:
        """Start receiving; `wake` is called from other threads after each message."""
        self._wake = wake
        self._transport = open_transport(self._config)
        for topic in self._topics:
            is_pose = topic.endswith("pose")
            kind, receive = (POSE, self._pose) if is_pose else (PEOPLE, self._people)
            self._transport.subscribe(topic, kind, partial(receive, topic), QUEUE)

    def take_truth(self) -> list[Truth]:
        """Return the truth received since the last call."""
        with self._lock:
            if self._poses and time.monotonic() > self._since_s + TOGETHER_S:
                self._gather()
            ready = list(self._ready)
            self._ready.clear()
        return ready

    def wake_s(self) -> float | None:
        """Return the monotonic time at which waiting poses are due [s]."""
        return self._since_s + TOGETHER_S if self._poses else None

    def close(self) -> None:
        """Stop receiving."""
        if self._transport:
            self._transport.close()

    def _people(self, topic: str, sample: Ros2Sample) -> None:
        truth = stamped_truth(types.decode(PEOPLE, sample.cdr))
        with self._lock:
            self._silent.pop(topic, None)
            self._add(truth)
        self._wake()

    def _pose(self, topic: str, sample: Ros2Sample) -> None:
        message = types.decode(POSE, sample.cdr)
        stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        if stamp_ns == 0:
            raise DecodeError("pose: expected the time of capture in header.stamp, got 0")
        frame_id = message.header.frame_id.strip("/").replace("/", "_") or "map"
        person = _person(topic, message.pose)
        _truth(stamp_ns, frame_id, (person,))  # rejects an invalid frame before poses are joined
        with self._lock:
            self._silent.pop(topic, None)
            waiting_ns = max((ns for ns, *_ in self._poses.values()), default=stamp_ns)
            if stamp_ns < waiting_ns:
                self._late["late_poses"] += 1
                return
            if stamp_ns > waiting_ns:
                self._gather()
            if not self._poses:
                self._since_s = time.monotonic()
            self._poses[topic] = stamp_ns, frame_id, person
            if len(self._poses) == sum(topic.endswith("pose") for topic in self._topics):
                self._gather()
        self._wake()

    def _gather(self) -> None:
        """Join the poses of each frame to one message, in the order of the topics."""
        poses = [self._poses[topic] for topic in self._topics if topic in self._poses]
        for frame_id in dict.fromkeys(frame for _, frame, _ in poses):
            of_frame = [one for one in poses if one[1] == frame_id]
            people = tuple(person for *_, person in of_frame)
            self._add(_truth(of_frame[0][0], frame_id, people))
        self._poses = {}

    def _add(self, truth: Truth) -> None:
        self._ready.append(truth)
        if len(self._ready) > WAITING_MAX:
            self._ready.popleft()
            self._late["skipped_truth"] += 1


def _truth(stamp_ns: int, frame_id: str, people: tuple[TruthPerson, ...]) -> Truth:
    """Return the truth of a frame; DecodeError if its name is invalid."""
    try:
        return Truth(stamp_ns=stamp_ns, sequence=0, frame_id=frame_id, people=people)
    except ValueError as error:
        raise DecodeError(f"pose: {error}") from error


def _person(topic: str, pose: Any) -> TruthPerson:
    """Return a person from a pose; DecodeError if a number is invalid."""
    parts = [part for part in topic.split("/") if part]
    name = parts[-2] if len(parts) > 1 else parts[-1]
    p, q = pose.position, pose.orientation
    yaw_rad = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
    known = math.isfinite(yaw_rad) and any((q.x, q.y, q.z, q.w))
    try:
        return TruthPerson(
            id=name,
            position_m=np.array([p.x, p.y, p.z], np.float64),
            velocity_mps=None,
            yaw_rad=yaw_rad if known else None,
        )
    except ValueError as error:
        raise DecodeError(f"pose: {error}") from error
