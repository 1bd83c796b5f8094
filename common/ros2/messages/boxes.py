"""People as boxes: vision_msgs."""

from common.ros2.messages.basic import header, pose
from common.ros2.messages.people import YAW_VARIANCE, covariance_6x6
from common.ros2.messages.person import RosPeople
from common.ros2.types import Fields

DETECTIONS = "vision_msgs/msg/Detection3DArray"


def detections(message: RosPeople, size_m: tuple[float, float, float]) -> Fields:
    """Return a vision_msgs/Detection3DArray of boxes of one size that stand on the floor, z = 0."""
    head = header(message.stamp_ns, message.frame_id)
    listed = []
    for person in message.people:
        x, y, _ = person.position_m
        covariance = covariance_6x6(person.covariance[:3, :3], (0.0, 0.0, YAW_VARIANCE))
        centre = pose((x, y, size_m[2] / 2), person.yaw_rad)
        hypothesis = {"class_id": "person", "score": person.score}
        result = {
            "hypothesis": hypothesis,
            "pose": {"pose": pose(person.position_m, person.yaw_rad), "covariance": covariance},
        }
        box = {"center": centre, "size": dict(zip("xyz", size_m, strict=True))}
        listed.append({"header": head, "results": [result], "bbox": box, "id": person.name})
    return {"header": head, "detections": listed}
