"""Truth from people_msgs/People in ROS 1 and ROS 2 bags."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from common.errors import SourceError
from common.messages import Truth, TruthPerson
from services.gt_bridge.config import GtBridgeConfig

PEOPLE = "people_msgs/msg/People"
DEFINITIONS = {
    "people_msgs/msg/Person": "string name\ngeometry_msgs/Point position\n"
    "geometry_msgs/Point velocity\nfloat64 reliability\nstring[] tagnames\nstring[] tags\n",
    PEOPLE: "std_msgs/Header header\npeople_msgs/Person[] people\n",
}


def people_typestore(distribution: Stores = Stores.ROS2_HUMBLE) -> Typestore:
    """Return the message types of a ROS distribution, people_msgs among them."""
    store = get_typestore(distribution)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store


class RosbagTruth:
    """The People messages of one topic of a bag.

    Raises:
        SourceError: The bag cannot be read, has no such topic, or has several and none is named.
    """

    def __init__(self, config: GtBridgeConfig) -> None:
        self._path = Path(config.truth)
        self._topic = config.topic
        for _ in self._messages(limit=0):
            pass  # opened once, so that a wrong bag is told at the start

    def __iter__(self) -> Iterator[Truth]:
        """Yield the messages in the order in which they were recorded.

        Raises:
            SourceError: The bag is damaged, or its frame has a name that cannot be used.
        """
        for sequence, message in enumerate(self._messages()):
            try:
                truth = _truth(message, sequence)
            except ValueError as error:
                raise SourceError(f"truth {self._path}: {error}") from error
            yield truth

    def _messages(self, limit: int | None = None) -> Iterator[Any]:
        # Bags that carry no definitions get ours; ROS 1 bags always carry theirs.
        try:
            with AnyReader([self._path], default_typestore=people_typestore()) as reader:
                chosen = self._choose(reader.connections)
                if limit == 0 or not chosen:
                    return
                for connection, _, data in reader.messages(chosen):
                    yield reader.deserialize(data, connection.msgtype)
        except SourceError:
            raise
        except Exception as error:  # a damaged bag makes rosbags raise almost anything
            raise SourceError(
                f"truth {self._path} cannot be read as a ROS bag: {error}", "Check the path."
            ) from error

    def _choose(self, connections: list[Connection]) -> list[Connection]:
        """Return the connections of the wanted topic; none where the bag holds no truth."""
        people = [c for c in connections if c.msgtype == PEOPLE]
        topics = sorted({c.topic for c in people})
        if self._topic and self._topic not in topics:
            raise SourceError(
                f"truth {self._path} has no topic {self._topic} of people_msgs/People",
                f"It has {', '.join(topics) or 'none of that type'}.",
            )
        if not self._topic and len(topics) > 1:
            raise SourceError(
                f"truth {self._path} has {len(topics)} topics of people_msgs/People",
                f"Set topic to one of {', '.join(topics)}.",
            )
        return [c for c in people if c.topic in (self._topic or topics[0])] if topics else []


def _truth(message: Any, sequence: int) -> Truth:
    stamp = message.header.stamp
    return Truth(
        stamp_ns=stamp.sec * 10**9 + stamp.nanosec,
        sequence=sequence,
        frame_id=message.header.frame_id.strip("/").replace("/", "_") or "map",
        people=tuple(
            TruthPerson(
                id=person.name,
                position_m=_vector(person.position),
                velocity_mps=_vector(person.velocity),
                yaw_rad=_angle(person, "yaw_rad"),
                path_yaw_rad=_angle(person, "path_yaw_rad"),
            )
            for person in message.people
            if np.all(np.isfinite([_vector(person.position), _vector(person.velocity)]))
        ),
    )


def _angle(person: Any, tag: str) -> float | None:
    """Return an angle from a tag that exported recordings have, None if there is none."""
    tags = dict(zip(person.tagnames, person.tags, strict=False))
    try:
        angle_rad = float(tags.get(tag, "nan"))
    except ValueError:
        return None
    return angle_rad if math.isfinite(angle_rad) else None


def _vector(point: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([point.x, point.y, point.z], np.float64)
