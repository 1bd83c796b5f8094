"""Truth from people_msgs/People, in ROS 1 and ROS 2 bags."""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from common.io.ros_bag import PEOPLE, open_bag
from people4d.errors import DecodeError, SourceError
from people4d.messages import F64, Truth, TruthPerson
from services.gt_bridge.config import GtBridgeConfig

SHOWN = 8  # maximum number of topics in an error


class RosbagTruth:
    """People messages of one topic of a bag; SourceError if it has none, or several."""

    def __init__(self, config: GtBridgeConfig) -> None:
        self._path = Path(config.truth)
        with open_bag(self._path, {}) as bag:
            self._topic = self._choose(config.topic, bag.types)

    def __iter__(self) -> Iterator[Truth]:
        """Yield the messages in the order of the bag; SourceError if it is damaged."""
        with open_bag(self._path, {}) as bag:
            for sequence, (_, _, message) in enumerate(bag.messages([self._topic])):
                try:
                    truth = truth_of(message, sequence)
                except ValueError as error:
                    raise SourceError(f"truth {self._path}: {error}") from error
                yield truth
            if bag.bad_messages:
                raise SourceError(f"truth {self._path}: {bag.bad_messages} messages cannot be read")

    def _choose(self, wanted: str, types: Mapping[str, str]) -> str:
        topics = sorted(topic for topic, kind in types.items() if kind == PEOPLE)
        if not topics:
            found = [f"{t} ({kind.replace('/msg/', '/')})" for t, kind in sorted(types.items())]
            raise SourceError(
                f"truth {self._path} has no people_msgs/People",
                f"It has {', '.join(found[:SHOWN]) or 'no topics'}. Poses are read live only.",
            )
        if wanted and wanted not in topics:
            raise SourceError(
                f"truth {self._path} has no topic {wanted} of people_msgs/People",
                f"It has {', '.join(topics)}.",
            )
        if not wanted and len(topics) > 1:
            raise SourceError(
                f"truth {self._path} has {len(topics)} topics of people_msgs/People",
                f"Set topic to one of {', '.join(topics)}.",
            )
        return wanted or topics[0]


def stamped_truth(message: Any) -> Truth:
    """Return live People as Truth; DecodeError without a stamp, or with an invalid value."""
    try:
        truth = truth_of(message, 0)
    except ValueError as error:
        raise DecodeError(f"people: {error}") from error
    if truth.stamp_ns == 0:
        raise DecodeError(
            "people: expected the time of capture in header.stamp, got 0",
            "Let the motion-capture node stamp its messages.",
        )
    return truth


def truth_of(message: Any, sequence: int) -> Truth:
    """Return a deserialised People message as Truth, without people of unknown position.

    ValueError if the name of the frame is invalid.
    """
    stamp = message.header.stamp
    return Truth(
        stamp_ns=stamp.sec * 10**9 + stamp.nanosec,
        sequence=sequence,
        frame_id=message.header.frame_id.strip("/").replace("/", "_") or "map",
        people=tuple(
            TruthPerson(
                id=person.name,
                position_m=_vector(person.position),
                velocity_mps=_known(_vector(person.velocity)),
                yaw_rad=_angle(person, "yaw_rad"),
                path_yaw_rad=_angle(person, "path_yaw_rad"),
            )
            for person in message.people
            if _known(_vector(person.position)) is not None
        ),
    )


def _angle(person: Any, tag: str) -> float | None:
    """Return an angle from a tag of exported recordings, None if it is absent."""
    tags = dict(zip(person.tagnames, person.tags, strict=False))
    try:
        angle_rad = float(tags.get(tag, "nan"))
    except ValueError:
        return None
    return angle_rad if math.isfinite(angle_rad) else None


def _known(vector: F64) -> F64 | None:
    return vector if np.all(np.isfinite(vector)) else None


def _vector(point: Any) -> F64:
    return np.array([point.x, point.y, point.z], np.float64)
