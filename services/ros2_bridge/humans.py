"""Topics of ROS4HRI (REP 155): bodies and persons, each with separate topics."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import msgspec
import numpy as np

from common.geometry.transforms import apply, rotation_from_rpy
from common.ros2.messages import hri, human_model
from common.ros2.messages.basic import header, xyz
from common.ros2.messages.person import RosPeople, RosPerson
from common.ros2.transport import DEFAULT, LATCHED, Ros2Transport
from common.ros2.types import Fields
from people4d.messages import F64, Detections, Event, PersonSkeleton, Skeletons
from services.ros2_bridge.config import OutputConfig
from services.ros2_bridge.output import Ros2Output

IMAGES_MAX = 16  # maximum number of detections that wait for their tracks
PEOPLE_MAX = 64  # maximum number of people with separate topics: each has thirteen publishers

BONES_MAX = 100  # maximum number of frames of the mean lengths of bones
BONE_M = 0.02  # minimum change of a length before the URDF is republished [m]

Image = tuple[str, int]  # camera and stamp


@dataclass(slots=True)
class _Human:
    """Topics of one person, with their state."""

    outputs: Mapping[str, Ros2Output]
    yaw_rad: float = 0.0  # yaw of the frame of the body
    is_left_up: bool = False  # True if the left wrist is the higher one
    lengths_m: F64 = field(default_factory=human_model.LENGTHS_M.copy)  # mean lengths of bones
    frames: int = 0  # number of frames of the mean
    sent_m: F64 | None = None  # lengths of the published URDF


class Humans:
    """Lists of bodies and persons, with region, skeleton, posture and motion of each.

    Args:
        config: First part of the topics' names, and the rate of all.
        transport: Node of the topics.
        counters: Counts sent messages, and people beyond PEOPLE_MAX.
    """

    def __init__(
        self, config: OutputConfig, transport: Ros2Transport, counters: Counter[str]
    ) -> None:
        self._config, self._transport, self._counters = config, transport, counters
        self._images: dict[Image, Detections] = {}
        self._people: dict[int, _Human] = {}  # people with topics by id
        self._bodies = self._output("bodies/tracked", hri.IDS)
        self._persons = self._output("persons/tracked", hri.IDS)
        counters["too_many_humans"] = 0

    def add_detections(self, message: Detections) -> None:
        """Store detections, the source of keypoints and regions."""
        self._images[message.camera, message.stamp_ns] = message
        while len(self._images) > IMAGES_MAX:
            del self._images[next(iter(self._images))]

    def send(self, message: RosPeople, key: Image, levels: Mapping[int, int]) -> None:
        """Publish people tracked in an image, with levels of engagement by id."""
        if not self._bodies.is_due(message.stamp_ns):
            return
        detections = self._images.get(key)
        self._counters["too_many_humans"] += max(len(message.people) - PEOPLE_MAX, 0)
        people = message.people[:PEOPLE_MAX]
        for number in self._people.keys() - {person.id for person in people}:
            for output in self._people.pop(number).outputs.values():
                output.close()
        for person in people:
            if person.id not in self._people:
                self._people[person.id] = _Human(self._announce(person))
            self._people[person.id].yaw_rad = person.yaw_rad
            head = header(message.stamp_ns, message.frame_id)
            self._send_motion(person, head)
            level = {"header": head, "level": levels.get(person.id, 0)}
            self._people[person.id].outputs["engagement"].send(level)
            if detections:
                image = msgspec.structs.replace(detections, stamp_ns=message.stamp_ns)
                self._send_parts(person, image)
        self._bodies.send(hri.ids(message, [hri.body_id(person) for person in people]))
        self._persons.send(hri.ids(message, [hri.person_id(person) for person in people]))

    def send_skeletons(
        self, message: Skeletons, stamp_ns: int, frame: tuple[F64 | None, str]
    ) -> None:
        """Publish postures and angles of joints of people with topics; joints name later gestures.

        Args:
            message: Skeletons of a frame.
            stamp_ns: Stamp for readers.
            frame: Transform from the frame of the skeletons to a frame of ROS, and its name.
        """
        matrix, frame_id = frame
        for person in message.people:
            human = self._people.get(person.id)
            if human and human.outputs["posture"].is_due(message.stamp_ns):
                head = header(stamp_ns, frame_id)
                human.outputs["posture"].send(hri.posture(person.posture, head))
                human.outputs["object_like"].send({"data": person.object_like})
                human.is_left_up = hri.is_left_up(person)
                if matrix is not None:
                    self._send_joints(person, human, head, matrix)

    def send_gesture(self, event: Event, stamp_ns: int) -> None:
        """Publish the gesture of an event, if it has one and its person has topics."""
        human = self._people.get(event.id or 0)
        if human and event.kind in hri.GESTURES:
            head = header(stamp_ns, event.frame_id)
            human.outputs["gesture"].send(hri.gesture(event.kind, human.is_left_up, head))

    def _announce(self, person: RosPerson) -> Mapping[str, Ros2Output]:
        """Create the topics of a person, and publish the id of its body."""
        body, own = f"bodies/{hri.body_id(person)}", f"persons/{hri.person_id(person)}"
        outputs = {
            "region": self._output(f"{body}/roi", hri.REGION),
            "skeleton": self._output(f"{body}/skeleton2d", hri.SKELETON),
            "posture": self._output(f"{body}/posture", hri.POSTURE),
            "object_like": self._output(f"{body}/object_like", hri.NUMBER),
            "gesture": self._output(f"{body}/gesture", hri.GESTURE),
            "joints": self._output(f"{body}/joint_states", hri.JOINTS),
            "urdf": self._output(f"{body}/urdf", hri.TEXT, latched=True),
            "position": self._output(f"{body}/position", hri.POINT),
            "velocity": self._output(f"{body}/velocity", hri.TWIST),
            "body_id": self._output(f"{own}/body_id", hri.TEXT, latched=True),
            "anonymous": self._output(f"{own}/anonymous", hri.FLAG, latched=True),
            "engagement": self._output(f"{own}/engagement_status", hri.ENGAGEMENT),
            "confidence": self._output(f"{own}/location_confidence", hri.NUMBER),
        }
        outputs["body_id"].send({"data": hri.body_id(person)})
        outputs["anonymous"].send({"data": True})
        return outputs

    def _send_joints(
        self, person: PersonSkeleton, human: _Human, head: Fields, matrix: F64
    ) -> None:
        """Publish the angles of joints, and the URDF if the lengths of bones changed."""
        joints_m = apply(matrix, person.positions_m.astype(np.float64))
        if all(person.measured[5:]):
            human.frames = min(human.frames + 1, BONES_MAX)
            new_m = human_model.bone_lengths(joints_m) - human.lengths_m
            human.lengths_m = human.lengths_m + new_m / human.frames
        body = hri.body_id(person)
        if human.sent_m is None or np.abs(human.lengths_m - human.sent_m).max() > BONE_M:
            human.sent_m = human.lengths_m
            human.outputs["urdf"].send({"data": human_model.urdf(body, human.lengths_m)})
        own_m = joints_m @ rotation_from_rpy(0.0, 0.0, human.yaw_rad)
        names = [f"{name}_{body}" for name in human_model.NAMES]
        joints = {"header": head, "name": names, "position": human_model.joint_angles(own_m)}
        human.outputs["joints"].send(joints)

    def _send_motion(self, person: RosPerson, head: Fields) -> None:
        outputs = self._people[person.id].outputs
        outputs["position"].send({"header": head, "point": xyz(person.position_m)})
        twist = {"linear": xyz(person.velocity_mps)}
        outputs["velocity"].send({"header": head, "twist": twist})
        # 1 while a body is seen, 0 for a predicted position
        outputs["confidence"].send({"data": float(person.state != "lost")})

    def _send_parts(self, person: RosPerson, image: Detections) -> None:
        detection, outputs = image.at(person.detection), self._people[person.id].outputs
        if detection is None:
            return
        outputs["region"].send(hri.region(detection, image))
        if detection.keypoints is not None:
            outputs["skeleton"].send(hri.skeleton(detection.keypoints, image))

    def _output(self, name: str, kind: str, latched: bool = False) -> Ros2Output:
        config = msgspec.structs.replace(self._config, topic=f"{self._config.topic}/{name}")
        qos = LATCHED if latched else DEFAULT
        return Ros2Output(self._transport, config, kind, self._counters, qos)
