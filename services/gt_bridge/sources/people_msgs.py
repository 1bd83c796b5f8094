"""People of motion capture in ROS: people_msgs/People."""

import math
from typing import Any

import numpy as np
from rosbags.typesys.store import Typestore

from common.io.ros_bag import PEOPLE_DEFINITIONS, make_typestore
from people4d.messages import F64, Truth, TruthPerson


def people_typestore(version: int = 2) -> Typestore:
    """Return the message types of ROS 1 or 2, people_msgs among them."""
    return make_typestore(version, PEOPLE_DEFINITIONS)


def truth_of(message: Any, sequence: int) -> Truth:
    """Turn a People message to Truth; people with NaN are left out.

    Args:
        message: As rosbags deserialises it.
        sequence: Number of the message.

    Raises:
        ValueError: The frame has a name that cannot be used.
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


def _vector(point: Any) -> F64:
    return np.array([point.x, point.y, point.z], np.float64)
