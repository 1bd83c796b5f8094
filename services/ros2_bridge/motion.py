"""Outputs of odometry and transforms."""

from collections import Counter
from collections.abc import Callable

import msgspec

from common.geometry.transform_buffer import transform_from_odometry
from common.geometry.transforms import rotation_from_rpy, transform_from
from common.ros2.messages import basic
from common.ros2.messages.hri import body_id
from common.ros2.messages.person import RosPeople
from common.ros2.transport import DEFAULT, LATCHED, Ros2Transport
from people4d.messages import F64, MovingTransform, Odometry, StaticTransform
from services.ros2_bridge.config import Ros2BridgeConfig
from services.ros2_bridge.output import Ros2Output
from services.ros2_bridge.reader_frames import ALWAYS_NS

FRAMES_MAX = 256  # maximum number of static transforms, all sent in one message

OnTransform = Callable[[str, str, int], None]  # called with parent, child and stamp [ns]


class MotionOutputs:
    """Outputs of odometry, /tf and /tf_static.

    Args:
        config: Published outputs.
        transport: Node of ROS 2 of the topics.
        counters: Sent messages (ros2_sent), and messages that ROS cannot hold (ros2_unfit).
        on_transform: Called with each published transform.
    """

    def __init__(
        self,
        config: Ros2BridgeConfig,
        transport: Ros2Transport,
        counters: Counter[str],
        on_transform: OnTransform,
    ) -> None:
        self._names, self._on_transform = config.frame_names, on_transform
        self._static: dict[str, tuple[str, str, F64]] = {}  # transform by child
        self._odometry = self._tf = self._tf_static = None
        outputs = config.outputs
        if "odometry" in config.publish:
            self._odometry = Ros2Output(transport, outputs.odometry, basic.ODOMETRY, counters)
        if "tf" in config.publish:
            self._tf = Ros2Output(transport, outputs.tf, basic.TF, counters, DEFAULT)
            static = msgspec.structs.replace(
                outputs.tf, topic=f"{outputs.tf.topic}_static", rate_max_hz=0.0
            )
            self._tf_static = Ros2Output(transport, static, basic.TF, counters, LATCHED)

    def send(self, message: StaticTransform | MovingTransform | Odometry) -> None:
        """Publish a moving transform or odometry, or all static transforms."""
        if isinstance(message, StaticTransform):
            self._send_static(message)
        elif isinstance(message, MovingTransform):
            self._send_moving(message.parent, message.child, message.matrix, message.stamp_ns)
        else:
            if self._odometry and self._odometry.is_due(message.stamp_ns):
                names = self._name(message.frame_id), self._name(message.child_frame_id)
                self._odometry.send(basic.odometry(message, *names))
            matrix = transform_from_odometry(message)
            edge = message.frame_id, message.child_frame_id
            self._send_moving(*edge, matrix, message.stamp_ns)

    def send_bodies(self, message: RosPeople) -> None:
        """Publish the frames of bodies of REP 155: x forward, z up, at the torso."""
        if self._tf and message.people:
            edges = (
                (
                    message.frame_id,
                    f"body_{body_id(person)}",
                    transform_from(person.position_m, rotation_from_rpy(0.0, 0.0, person.yaw_rad)),
                )
                for person in message.people
            )
            self._tf.send(basic.transforms(edges, message.stamp_ns))

    def _send_static(self, message: StaticTransform) -> None:
        known = message.child in self._static or len(self._static) < FRAMES_MAX
        if self._tf_static and known:
            parent, child = self._name(message.parent), self._name(message.child)
            self._static[message.child] = parent, child, message.matrix
            # A latched topic holds one message of each publisher.
            self._tf_static.send(basic.transforms(self._static.values(), message.stamp_ns))
            self._on_transform(parent, child, ALWAYS_NS)

    def _send_moving(self, parent: str, child: str, matrix: F64, stamp_ns: int) -> None:
        if self._tf:
            parent, child = self._name(parent), self._name(child)
            self._tf.send(basic.transforms([(parent, child, matrix)], stamp_ns))
            self._on_transform(parent, child, stamp_ns)

    def _name(self, frame: str) -> str:
        return self._names.get(frame, frame)
