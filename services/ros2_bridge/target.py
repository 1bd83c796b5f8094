"""The chosen person in ROS 2: pose, person and marker out, commands in."""

import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from typing import Literal

import msgspec
import numpy as np

from common.ros2 import types
from common.ros2.messages.basic import header, pose, xyz
from common.ros2.messages.basic import time as ros_time
from common.ros2.transport import Ros2Sample, Ros2Transport
from people4d.messages import F64, Target, TargetCommand
from services.ros2_bridge.config import Ros2BridgeConfig
from services.ros2_bridge.output import Ros2Output

POSE = "geometry_msgs/msg/PoseStamped"
PERSON = "people_msgs/msg/Person"
MARKER = "visualization_msgs/msg/Marker"
TEXT = "std_msgs/msg/String"
CYLINDER, LIFETIME_NS = 3, 500_000_000  # type and lifetime [ns] of the marker
RING_M, GREEN = (0.9, 0.9, 0.02), {"r": 0.1, "g": 0.8, "b": 0.2, "a": 0.6}
CHOOSER = "ROS 2"
PLAIN: tuple[Literal["nearest", "raised_hand", "none"], ...] = ("nearest", "raised_hand", "none")
COMMANDS_MAX = 8  # maximum number of commands that wait


class TargetOutput:
    """Topics of the chosen person; without a locked or occluded person none is sent.

    Args:
        config: Published outputs.
        transport: Node of ROS 2 of the topics.
        counters: Counts ros2_sent, ros2_unfit and bad_command: commands without a meaning.
        wake: Called after a command, in a thread of the transport.
    """

    def __init__(
        self,
        config: Ros2BridgeConfig,
        transport: Ros2Transport,
        counters: Counter[str],
        wake: Callable[[], None],
    ) -> None:
        self._counters, self._wake = counters, wake
        self._commands = deque[TargetCommand](maxlen=COMMANDS_MAX)
        self._sequence = 0
        output = config.outputs.target

        def made(suffix: str, kind: str) -> Ros2Output:
            topic = msgspec.structs.replace(output, topic=output.topic + suffix)
            return Ros2Output(transport, topic, kind, counters)

        self._pose = made("", POSE)
        self._person, self._marker = made("/person", PERSON), made("/marker", MARKER)
        counters["bad_command"] += 0
        transport.subscribe(f"{output.topic}/follow", TEXT, self._receive)

    def send(self, message: Target, stamp_ns: int, matrix: F64, frame_id: str) -> None:
        """Publish the person in a frame of ROS; `matrix` leads from the message's frame to it."""
        if message.position_m is None or message.velocity_mps is None:
            return
        if not self._pose.is_due(message.stamp_ns):
            return
        x, y, z = (matrix[:3, :3] @ message.position_m + matrix[:3, 3]).tolist()
        velocity_mps = (matrix[:3, :3] @ message.velocity_mps).tolist()
        yaw_rad = float(np.arctan2(velocity_mps[1], velocity_mps[0]))
        head = header(stamp_ns, frame_id)
        self._pose.send({"header": head, "pose": pose((x, y, z), yaw_rad)})
        tags = {"id": str(message.id), "state": message.state}
        self._person.send(
            {
                "name": f"person_{message.id}",
                "position": xyz((x, y, z)),
                "velocity": xyz(velocity_mps),
                "reliability": message.probability,
                "tagnames": list(tags),
                "tags": list(tags.values()),
            }
        )
        ring = {"type": CYLINDER, "pose": pose((x, y, 0.01), 0.0), "scale": xyz(RING_M)}
        common = {"header": head, "ns": "target", "lifetime": ros_time(LIFETIME_NS)}
        self._marker.send({**common, **ring, "color": GREEN})

    def take_commands(self) -> Iterator[TargetCommand]:
        """Yield the commands since the last call."""
        while self._commands:
            self._sequence += 1
            command = self._commands.popleft()
            yield msgspec.structs.replace(command, sequence=self._sequence - 1)

    def _receive(self, sample: Ros2Sample) -> None:
        try:
            self._commands.append(command_of(str(types.decode(TEXT, sample.cdr).data)))
        except ValueError:
            self._counters["bad_command"] += 1
        else:
            self._wake()


def command_of(text: str) -> TargetCommand:
    """Return the command of a text.

    It is the number of a track, `nearest`, `raised_hand`, `none`, or `X Y` in metres.

    Raises:
        ValueError: The text is no command.
    """
    words, stamp_ns = text.split(), time.time_ns()
    for action in PLAIN:
        if words == [action]:
            return TargetCommand(stamp_ns=stamp_ns, sequence=0, action=action, chooser=CHOOSER)
    if len(words) == 1:
        return TargetCommand(
            stamp_ns=stamp_ns, sequence=0, action="id", id=_positive(words[0]), chooser=CHOOSER
        )
    if len(words) != 2:
        raise ValueError(
            f"expected the number of a track, {', '.join(PLAIN)}, or x and y in metres"
        )
    at_m = np.array([float(word) for word in words])
    if not np.isfinite(at_m).all():
        raise ValueError("expected finite numbers")
    return TargetCommand(
        stamp_ns=stamp_ns, sequence=0, action="at", position_m=at_m, chooser=CHOOSER
    )


def _positive(word: str) -> int:
    number = int(word)
    if number < 1:
        raise ValueError("expected a positive number")
    return number
