"""Node of the bridge, which publishes messages of people4d as topics of ROS 2."""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import msgspec

from common.ros2.messages.basic import CLOCK
from common.ros2.messages.basic import time as ros_time
from common.ros2.messages.health import DIAGNOSTICS, diagnostics
from common.ros2.messages.person import RosPeople, RosPeopleView
from common.ros2.transport import Ros2Transport
from common.runtime.node import NO_LOOP, LoopCallbacks, Node, Status
from common.transport.stream_clock import EXTRAPOLATION_MAX_NS, StreamClock
from people4d.messages import (
    Detections,
    Event,
    Health,
    Message,
    MovingTransform,
    Odometry,
    Predictions,
    Skeletons,
    StaticTransform,
    Target,
    Tracks,
)
from services.ros2_bridge.config import Ros2BridgeConfig
from services.ros2_bridge.engagement import Engagement
from services.ros2_bridge.humans import Humans, Image
from services.ros2_bridge.motion import MotionOutputs
from services.ros2_bridge.output import Ros2Output
from services.ros2_bridge.people import PeopleOutputs
from services.ros2_bridge.reader_frames import ReaderFrames
from services.ros2_bridge.target import TargetOutput

COUNTERS = ("reader_unlinked", "reader_restamped", "reader_waits", "not_extrapolated")
STAMP_MAX_NS = 2**31 * 10**9  # builtin_interfaces/Time has 31 bits of seconds
GROUPS_NS = 1_000_000_000  # maximum age of predicted groups [ns]
PENDING_MAX = 16  # maximum number of messages that wait for transforms
INSTANCES_MAX = 1024  # maximum number of processes in diagnostics
HEALTH_NS = 3_000_000_000  # maximum age of the last heartbeat of an active process [ns]


@dataclass(frozen=True)
class _Pending:
    """People that wait for transforms up to their stamp."""

    people: RosPeople
    image: Image
    until_ns: int  # monotonic deadline [ns]


class Ros2BridgeNode(Node):
    """Publishes the configured outputs, and counts messages that cannot be sent.

    Args:
        config: Published outputs.
        transport: Node of ROS 2; closed with this node.
        wall_ns: The wall clock.
    """

    inputs: tuple[type[Message], ...] = (
        *(Tracks, Predictions, Detections, Skeletons, Event, Health, Target),
        *(StaticTransform, MovingTransform, Odometry),
    )
    required_inputs: ClassVar[tuple[type[Message], ...]] = (Tracks,)

    def __init__(
        self,
        config: Ros2BridgeConfig,
        transport: Ros2Transport,
        wall_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._config, self._transport, self._wall_ns = config, transport, wall_ns
        self._stream, self._is_sent = StreamClock(wall_ns), config.stamps == "sent"
        self._offset_ns = 0  # wall time minus stamp of the last people [ns]
        self._counters = Counter(dict.fromkeys(COUNTERS, 0))
        self._loop = NO_LOOP
        self._view = RosPeopleView()
        self._groups: tuple[int, dict[int, int]] = (0, {})  # stamp, and group by the person's id
        self._pending: list[_Pending] = []
        self._reader = ReaderFrames(self._counters, self._wake)
        if config.reader_frame:
            self._reader.subscribe(transport)
        self._people = PeopleOutputs(config, transport, self._counters)
        self._motion = MotionOutputs(config, transport, self._counters, self._reader.add_transform)
        self._humans: Humans | None = None
        if "humans" in config.publish:
            self._humans = Humans(config.outputs.humans, transport, self._counters)
        self._engagement, self._levels = Engagement(), dict[int, int]()
        self._target: TargetOutput | None = None
        if "target" in config.publish:
            self._target = TargetOutput(config, transport, self._counters, self._wake)
        self._diagnostics: Ros2Output | None = None
        if "diagnostics" in config.publish:
            kind, counters = DIAGNOSTICS, self._counters
            self._diagnostics = Ros2Output(transport, config.outputs.diagnostics, kind, counters)
        self._clock: Ros2Output | None = None
        if "clock" in config.publish:
            self._clock = Ros2Output(transport, config.outputs.clock, CLOCK, self._counters)
        self._healths: dict[str, tuple[Health, int]] = {}
        self._report_ns: int | None = None
        self._unlinked = False
        self._too_far_s = 0.0  # rejected time step of the last people [s]; 0: none

    def attach(self, loop: LoopCallbacks) -> None:
        """Set the callbacks of the loop."""
        self._loop = loop

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Publish a message, or count it if ROS cannot hold its stamp."""
        if not 0 <= message.stamp_ns < STAMP_MAX_NS:
            self._counters["ros2_unfit"] += 1
        elif isinstance(message, Tracks):
            self._take_tracks(message, now_ns)
        elif isinstance(message, Predictions):
            groups = {one.id: one.group for one in message.people if one.group is not None}
            self._groups = message.stamp_ns, groups
            self._people.send_predictions(message, self._stamp_ns(message))
        elif isinstance(message, Detections):
            if self._humans:
                self._humans.add_detections(message)
        elif isinstance(message, Skeletons):
            if self._humans:
                frame = self._people.frame_of(message.frame_id, message.stamp_ns)
                self._humans.send_skeletons(message, self._stamp_ns(message), frame)
        elif isinstance(message, Event):
            if self._humans:
                self._humans.send_gesture(message, self._stamp_ns(message))
        elif isinstance(message, Target):
            matrix, frame_id = self._people.frame_of(message.frame_id, message.stamp_ns)
            if self._target and matrix is not None:
                self._target.send(message, self._stamp_ns(message), matrix, frame_id)
        elif isinstance(message, Health):
            if message.instance in self._healths or len(self._healths) < INSTANCES_MAX:
                self._healths[message.instance] = message, now_ns
        elif isinstance(message, StaticTransform | MovingTransform | Odometry):
            self._people.add_transform(message)
            self._motion.send(msgspec.structs.replace(message, stamp_ns=self._stamp_ns(message)))
        return ()

    def tick(self, now_ns: int) -> Sequence[Message]:
        """Publish people whose transforms arrived and due diagnostics; return commands of ROS."""
        waiting, self._pending = self._pending, []
        for pending in waiting:
            self._send_when_linked(pending, now_ns)
        if self._diagnostics and self._diagnostics.is_due(now_ns):
            self._healths = {
                name: (health, at_ns)
                for name, (health, at_ns) in self._healths.items()
                if health.state != "stopping"
            }
            healths = (
                (health, now_ns - at_ns < HEALTH_NS) for health, at_ns in self._healths.values()
            )
            self._diagnostics.send(diagnostics(healths, self._wall_ns()))
            rate_hz = self._config.outputs.diagnostics.rate_max_hz or 1.0
            self._report_ns = now_ns + round(1e9 / rate_hz)
        return list(self._target.take_commands()) if self._target else ()

    def wake_ns(self) -> int | None:
        """Return the time at which waiting people or diagnostics are due [ns]."""
        times = [pending.until_ns for pending in self._pending]
        return min([*times, *([] if self._report_ns is None else [self._report_ns])], default=None)

    def status(self) -> Status:
        """Return state, reason and counters."""
        counters = {**self._counters, **self._transport.counters}
        if self._unlinked:
            reason = f"nothing links the frame of people to {self._config.reader_frame} on /tf"
            return Status(state="degraded", reason=reason, counters=counters)
        if self._people.problem:
            return Status(state="degraded", reason=self._people.problem, counters=counters)
        if self._too_far_s:
            reason = (
                f"people are {abs(self._too_far_s):.1f} s "
                f"{'behind' if self._too_far_s > 0 else 'ahead of'} the time of their message, and "
                f"moved by at most {EXTRAPOLATION_MAX_NS / 1e9:g} s"
            )
            return Status(state="degraded", reason=reason, counters=counters)
        is_mapped = self._is_sent or self._clock
        gauges = {} if is_mapped else {"stamps_behind_s": self._offset_ns / 1e9}
        return Status(counters=counters, gauges=gauges)

    def close(self) -> None:
        """Leave the ROS 2 graph."""
        self._transport.close()

    def _wake(self) -> None:
        self._loop.wake()  # the loop is attached later

    def _stamp_ns(self, message: Message) -> int:
        """Return the stamp of a message for readers: its own, or its wall time."""
        if self._is_sent and not isinstance(message, StaticTransform):
            return self._stream.wall_ns(message)
        return message.stamp_ns

    def _take_tracks(self, message: Tracks, now_ns: int) -> None:
        stamp_ns, sent_ns = self._stream.wall_ns(message), self._wall_ns()
        self._offset_ns = stamp_ns - message.stamp_ns
        if self._clock:
            time_ns = sent_ns if self._is_sent else sent_ns - self._offset_ns
            self._clock.send({"clock": ros_time(time_ns)})
        if self._humans:
            base = self._config.base_frame
            robot_m = self._people.robot_m(base, message.frame_id, message.stamp_ns)
            self._levels = self._engagement.update(message, robot_m)
        groups_ns, groups = self._groups
        recent = abs(message.stamp_ns - groups_ns) < GROUPS_NS
        people = self._view.tracks(message, groups if recent else {}, self._config.states)
        found = self._people.in_frame(people)
        # People are unknown, not absent
        if found is None or (message.predicted and not found.people):
            return
        if self._is_sent:
            found = self._moved(replace(found, stamp_ns=stamp_ns), sent_ns)
            if found is None:
                return
        image = message.camera, message.stamp_ns
        until_ns = now_ns + round(self._config.reader_wait_s * 1e9)
        self._send_when_linked(_Pending(found, image, until_ns), now_ns)

    def _send_when_linked(self, pending: _Pending, now_ns: int) -> None:
        """Publish people once a reader can look up their frame at their stamp.

        After the maximum wait, people are moved to the newest possible stamp.
        """
        people, target = pending.people, self._config.reader_frame
        if not target or target == people.frame_id:
            self._send(people, pending.image)
            return
        newest_ns = self._reader.newest_ns(target, people.frame_id)
        if newest_ns is not None and newest_ns >= people.stamp_ns:
            self._unlinked = False
            self._send(people, pending.image)
        elif now_ns < pending.until_ns and len(self._pending) < PENDING_MAX:
            self._counters["reader_waits"] += 1
            self._pending.append(pending)
        elif newest_ns is None:
            self._unlinked = True
            self._counters["reader_unlinked"] += 1
        else:
            self._unlinked = False
            moved = self._moved(people, newest_ns)
            if moved:
                self._counters["reader_restamped"] += 1
                self._send(moved, pending.image)

    def _moved(self, people: RosPeople, stamp_ns: int) -> RosPeople | None:
        """Return people at another time; None, and counted, if it is too far away."""
        moved = people.at(stamp_ns)
        self._too_far_s = 0.0 if moved else (stamp_ns - people.stamp_ns) / 1e9
        self._counters["not_extrapolated"] += 0 if moved else len(people.people)
        return moved

    def _send(self, people: RosPeople, image: Image) -> None:
        self._people.send(people)
        if self._humans:
            self._humans.send(people, image, self._levels)
            self._motion.send_bodies(people)
