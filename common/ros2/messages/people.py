"""People as messages of planners: people_msgs, social_nav_msgs, cohan_msgs, spencer_tracking_msgs.

Conventions of their readers are in tests/ros2_bridge/test_consumers.py.
"""

import numpy as np

from common.ros2.messages.basic import header, pose, time, xyz
from common.ros2.messages.person import RosPeople, RosPerson
from common.ros2.types import Fields
from people4d.messages import F64

PEOPLE = "people_msgs/msg/People"
PEDESTRIANS = "social_nav_msgs/msg/PedestriansWithCovariance"
AGENTS = "cohan_msgs/msg/TrackedAgents"
PERSONS = "spencer_tracking_msgs/msg/TrackedPersons"

HUMAN, TORSO = 1, 1  # cohan_msgs/AgentType and TrackedSegmentType
STATIC, MOVING = 0, 1  # cohan_msgs/TrackedAgent
UNSET = 99999.0 + 1  # variance of unknown numbers in spencer_tracking_msgs
YAW_VARIANCE = 0.12  # variance of a yaw, (20 deg)^2 [rad^2]


def people(message: RosPeople, convention: str = "nav2") -> Fields:
    """Return a people_msgs/People.

    Tags begin with id and group as text, at the indices expected by readers.

    Args:
        message: Tracked people.
        convention: "nav2": positions and velocities, whose x and y are read.
            "sfm": position.z is the yaw [rad] and velocity.z its rate [rad/s].
    """
    return {
        "header": header(message.stamp_ns, message.frame_id),
        "people": [_person(person, convention) for person in message.people],
    }


def _person(person: RosPerson, convention: str) -> Fields:
    (x, y, z), (vx, vy, vz) = person.position_m, person.velocity_mps
    if convention == "sfm":
        z, vz = person.yaw_rad, person.yaw_rate_radps
    tags = {"id": str(person.id), "group": str(person.group), "state": person.state}
    if person.yaw_known:
        tags["yaw_rad"] = repr(person.yaw_rad)
    if person.path_yaw_rad is not None:
        tags["path_yaw_rad"] = repr(person.path_yaw_rad)
    return {
        "name": person.name,
        "position": xyz((x, y, z)),
        "velocity": xyz((vx, vy, vz)),
        "reliability": person.score,
        "tagnames": list(tags),
        "tags": list(tags.values()),
    }


def pedestrians(message: RosPeople) -> Fields:
    """Return a social_nav_msgs/PedestriansWithCovariance."""
    listed = [
        {
            "pedestrian": {
                "identifier": person.name,
                "pose": {"x": x, "y": y, "theta": person.yaw_rad},
                "velocity": {"x": vx, "y": vy, "theta": person.yaw_rate_radps},
            },
            "covariance": person.covariance[:2, :2],
        }
        for person in message.people
        for (x, y, _), (vx, vy, _) in [(person.position_m, person.velocity_mps)]
    ]
    return {"header": header(message.stamp_ns, message.frame_id), "pedestrians": listed}


def agents(message: RosPeople) -> Fields:
    """Return a cohan_msgs/TrackedAgents: torsos of people, numbered consecutively from 1."""
    listed = [
        {
            "track_id": person.slot,
            "state": MOVING if person.moves else STATIC,
            "type": HUMAN,
            "name": f"human{person.id}",
            "segments": [{"type": TORSO, **_motion(person, 0.0)}],
        }
        for person in message.people
    ]
    return {"header": header(message.stamp_ns, message.frame_id), "agents": listed}


def persons(message: RosPeople) -> Fields:
    """Return a spencer_tracking_msgs/TrackedPersons."""
    listed = [
        {
            "track_id": person.id,
            "is_occluded": person.detection is None,
            "is_matched": person.detection is not None,
            "detection_id": person.detection or 0,
            "age": time(round(person.age_s * 1e9)),
            **_motion(person, UNSET),
        }
        for person in message.people
    ]
    return {"header": header(message.stamp_ns, message.frame_id), "tracks": listed}


def _motion(person: RosPerson, unset: float) -> Fields:
    """Return pose and twist with covariance; `unset` is the variance of unknown numbers."""
    twist = {"linear": xyz(person.velocity_mps), "angular": xyz((0.0, 0.0, person.yaw_rate_radps))}
    yaw_variance = YAW_VARIANCE if person.yaw_known else unset
    turning = (unset, unset, yaw_variance)
    return {
        "pose": {
            "pose": pose(person.position_m, person.yaw_rad),
            "covariance": covariance_6x6(person.covariance[:3, :3], turning),
        },
        "twist": {"twist": twist, "covariance": covariance_6x6(person.covariance[3:, 3:], turning)},
    }


def covariance_6x6(covariance: F64, turning: tuple[float, float, float]) -> F64:
    """Return the covariance of x, y, z and of rotations about them, given by variances."""
    full = np.zeros((6, 6))
    full[:3, :3] = covariance
    full[3, 3], full[4, 4], full[5, 5] = turning
    return full
