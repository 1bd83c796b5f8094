"""Outputs of people and predictions, in the frame of their readers."""

from collections import Counter
from collections.abc import Callable
from functools import partial

import msgspec
import numpy as np

from common.geometry.transform_buffer import TransformBuffer
from common.ros2.messages import boxes, markers, people
from common.ros2.messages.basic import header
from common.ros2.messages.person import RosPeople
from common.ros2.transport import Ros2Transport
from common.ros2.types import Fields
from people4d.messages import F64, MovingTransform, Odometry, Predictions, StaticTransform
from services.ros2_bridge.config import Ros2BridgeConfig
from services.ros2_bridge.output import Ros2Output

COUNTERS = ("unknown_frame",)


class PeopleOutputs:
    """Topics with all people in one message, and predictions.

    Args:
        config: Published outputs.
        transport: Node of the topics.
        counters: Counts `COUNTERS`: messages that cannot be transformed to the frame.
    """

    def __init__(
        self, config: Ros2BridgeConfig, transport: Ros2Transport, counters: Counter[str]
    ) -> None:
        self._config, self._counters = config, counters
        self._transforms = TransformBuffer()
        outputs = config.outputs
        kinds: dict[str, tuple[str, Callable[[RosPeople], Fields]]] = {
            "people": (people.PEOPLE, partial(people.people, convention=config.convention)),
            "pedestrians": (people.PEDESTRIANS, people.pedestrians),
            "agents": (people.AGENTS, people.agents),
            "tracked_persons": (people.PERSONS, people.persons),
            "boxes": (boxes.DETECTIONS, partial(boxes.detections, size_m=config.box_m)),
            "markers": (
                markers.MARKERS,
                partial(markers.people_markers, size_m=config.box_m),
            ),
        }
        configs = msgspec.structs.asdict(outputs)
        self._outputs = [
            (Ros2Output(transport, configs[name], kind, counters), convert)
            for name, (kind, convert) in kinds.items()
            if name in config.publish
        ]
        self._predictions: Ros2Output | None = None
        if "prediction_markers" in config.publish:
            self._predictions = Ros2Output(
                transport, outputs.prediction_markers, markers.MARKERS, counters
            )
        self._counters.update(dict.fromkeys(COUNTERS, 0))
        self.problem = ""  # reason why the last message was not sent

    def add_transform(self, message: StaticTransform | MovingTransform | Odometry) -> None:
        """Add a transform."""
        self._transforms.add_transform(message)

    def in_frame(self, message: RosPeople) -> RosPeople | None:
        """Return people in the frame of ROS; None if no transform leads to it."""
        matrix, frame_id = self.frame_of(message.frame_id, message.stamp_ns)
        if matrix is None:
            return None
        if frame_id != message.frame_id:
            return message.transformed(matrix, frame_id)
        return message

    def send(self, message: RosPeople) -> None:
        """Publish people."""
        for output, convert in self._outputs:
            if output.is_due(message.stamp_ns):
                output.send(convert(message))

    def send_predictions(self, message: Predictions, stamp_ns: int) -> None:
        """Publish predictions, with a stamp for readers."""
        if not self._predictions or not self._predictions.is_due(message.stamp_ns):
            return
        matrix, frame_id = self.frame_of(message.frame_id, message.stamp_ns)
        if matrix is not None:
            head = header(stamp_ns, frame_id)
            self._predictions.send(markers.prediction_markers(_moved(message, matrix), head))

    def robot_m(self, base: str, frame_id: str, stamp_ns: int) -> F64 | None:
        """Return the position of the robot's base in a frame; None if unknown."""
        found = self._transforms.lookup(frame_id, base, stamp_ns)
        return None if found is None else found.matrix[:3, 3]

    def frame_of(self, source: str, stamp_ns: int) -> tuple[F64 | None, str]:
        """Return the transform from a frame to the frame of ROS, and the name of the ROS frame."""
        target = self._config.frame_id or source
        frame_id = self._config.frame_names.get(target, target)
        if target == source:
            return np.eye(4), frame_id
        found = self._transforms.lookup(target, source, stamp_ns)
        if found is None:
            self._counters["unknown_frame"] += 1
            self.problem = f"no transform leads from {source} to {target}"
            return None, frame_id
        self.problem = ""
        return found.matrix, frame_id


def _moved(message: Predictions, target_from_source: F64) -> Predictions:
    """Transform predictions to another frame. Both frames have a vertical z axis."""
    rotation, shift = target_from_source[:3, :3], target_from_source[:3, 3]
    plane = rotation[:2, :2]
    people = tuple(
        msgspec.structs.replace(
            person,
            position_m=rotation @ person.position_m + shift,
            means_m=person.means_m @ plane.T + shift[:2],
            covariances_m2=_symmetric(plane @ person.covariances_m2 @ plane.T),
        )
        for person in message.people
    )
    return msgspec.structs.replace(message, people=people)


def _symmetric(matrices: F64) -> F64:
    return (matrices + matrices.transpose(0, 2, 1)) / 2
