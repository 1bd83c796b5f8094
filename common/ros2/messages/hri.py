"""ROS4HRI messages (REP 155): ids of persons and bodies, regions and skeletons in the image."""

import numpy as np

from common.ros2.messages.basic import header
from common.ros2.messages.person import RosPeople, RosPerson
from common.ros2.types import Fields
from people4d.messages import F32, Detection, Detections, PersonSkeleton
from people4d.messages.skeleton import Posture

IDS = "hri_msgs/msg/IdsList"
REGION = "hri_msgs/msg/NormalizedRegionOfInterest2D"
SKELETON = "hri_msgs/msg/Skeleton2D"
POSTURE = "hri_msgs/msg/BodyPosture"
GESTURE = "hri_msgs/msg/Gesture"
ENGAGEMENT = "hri_msgs/msg/EngagementLevel"
JOINTS = "sensor_msgs/msg/JointState"
POINT, TWIST = "geometry_msgs/msg/PointStamped", "geometry_msgs/msg/TwistStamped"
TEXT, FLAG, NUMBER = "std_msgs/msg/String", "std_msgs/msg/Bool", "std_msgs/msg/Float32"

# COCO keypoint by joint of hri_msgs/Skeleton2D; None: the neck, the middle of the shoulders.
COCO = (0, None, 6, 8, 10, 5, 7, 9, 12, 14, 16, 11, 13, 15, 1, 2, 3, 4)
SHOULDERS = (5, 6)
LEFT_WRIST, RIGHT_WRIST = 9, 10
# Constants of hri_msgs/BodyPosture: bending is not among them, unlike crouching
POSTURES: dict[Posture, int] = {"standing": 1, "walking": 1, "sitting": 2, "lying": 4}
# Constants of hri_msgs/Gesture by event; the right hand is the next number after the left
GESTURES = {"raised_hand": 3, "waved": 6}


def body_id(person: RosPerson | PersonSkeleton) -> str:
    """Return the id of a person's body; a part of a topic's name cannot begin with a digit."""
    return f"b{person.id:05d}"


def person_id(person: RosPerson) -> str:
    """Return the id of a person."""
    return f"p{person.id:05d}"


def ids(message: RosPeople, names: list[str]) -> Fields:
    """Return a hri_msgs/IdsList."""
    return {"header": header(message.stamp_ns, message.frame_id), "ids": names}


def region(detection: Detection, image: Detections) -> Fields:
    """Return a hri_msgs/NormalizedRegionOfInterest2D: the box inside the image, 0 to 1."""
    x0, y0, x1, y1 = detection.box_xyxy_px.tolist()
    return {
        "header": header(image.stamp_ns, image.frame_id),
        "xmin": _clip(x0 / image.width),
        "ymin": _clip(y0 / image.height),
        "xmax": _clip(x1 / image.width),
        "ymax": _clip(y1 / image.height),
        "c": detection.score,
    }


def skeleton(keypoints: F32, image: Detections) -> Fields:
    """Return a hri_msgs/Skeleton2D of COCO's 17 keypoints, unseen outside the image."""
    neck = keypoints[list(SHOULDERS)]
    neck = np.array([*neck[:, :2].mean(0), neck[:, 2].min()])
    points = [neck if index is None else keypoints[index] for index in COCO]
    normal = [(float(u) / image.width, float(v) / image.height, float(c)) for u, v, c in points]
    return {
        "header": header(image.stamp_ns, image.frame_id),
        "skeleton": [
            {"x": _clip(x), "y": _clip(y), "c": _clip(c) if 0 <= x <= 1 and 0 <= y <= 1 else 0.0}
            for x, y, c in normal
        ],
    }


def posture(name: Posture, head: Fields) -> Fields:
    """Return a hri_msgs/BodyPosture."""
    return {"header": head, "posture": POSTURES.get(name, 0)}


def gesture(kind: str, is_left: bool, head: Fields) -> Fields:
    """Return a hri_msgs/Gesture of an event."""
    return {"header": head, "gesture": GESTURES[kind] + (kind == "raised_hand" and not is_left)}


def is_left_up(person: PersonSkeleton) -> bool:
    """Check whether the left wrist is the higher one."""
    return bool(person.positions_m[LEFT_WRIST, 2] > person.positions_m[RIGHT_WRIST, 2])


def _clip(value: float) -> float:
    return min(max(value, 0.0), 1.0)
