"""People and predictions for RViz: visualization_msgs."""

import math
from collections.abc import Iterator

import numpy as np

from common.ros2.messages.basic import header, pose, time, xyz
from common.ros2.messages.person import RosPeople, RosPerson
from common.ros2.types import Fields
from people4d.messages import F64
from people4d.messages.prediction import PersonPrediction, Predictions

MARKERS = "visualization_msgs/msg/MarkerArray"

# visualization_msgs/Marker
ARROW, CUBE, CYLINDER, LINES, TEXT = 0, 1, 3, 4, 9

ELLIPSE_SIGMAS = 2.146  # half axes of a 90 % ellipse, in standard deviations
GOLDEN = 0.618033988749895  # step of the hue between ids
LIFETIME_NS = 500_000_000  # lifetime of a marker [ns]
FLOOR_M = 0.01  # thickness and height of markers on the floor [m]


def people_markers(message: RosPeople, size_m: tuple[float, float, float]) -> Fields:
    """Return a MarkerArray: box, heading, speed, id and 90 % ellipse of each person."""
    head = header(message.stamp_ns, message.frame_id)
    markers = [one for person in message.people for one in _of_person(person, head, size_m)]
    return {"markers": markers}


def _of_person(
    person: RosPerson, head: Fields, size_m: tuple[float, float, float]
) -> Iterator[Fields]:
    (x, y, _), height_m, yaw_rad = person.position_m, size_m[2], person.yaw_rad
    common = {
        "header": head,
        "id": person.id,
        "lifetime": time(LIFETIME_NS),
        "color": _colour(person.id, 0.35 if person.state == "lost" else 0.8),
    }
    box, chest = pose((x, y, height_m / 2), yaw_rad), pose((x, y, 0.75 * height_m), yaw_rad)
    yield {**common, "ns": "box", "type": CUBE, "pose": box, "scale": xyz(size_m)}
    if person.yaw_known:
        arrow = {"type": ARROW, "pose": chest, "scale": xyz((0.6, 0.06, 0.06))}
        yield {**common, "ns": "heading", **arrow}
    if person.moves:
        vx, vy, _ = person.velocity_mps
        feet, scale = pose((x, y, 0.05), math.atan2(vy, vx)), (math.hypot(vx, vy), 0.05, 0.05)
        yield {**common, "ns": "velocity", "type": ARROW, "pose": feet, "scale": xyz(scale)}
    above = pose((x, y, height_m + 0.15), 0.0)
    text = {"type": TEXT, "pose": above, "scale": xyz((0.0, 0.0, 0.25)), "text": person.name}
    yield {**common, "ns": "id", **text, "color": _colour(person.id, 1.0)}
    if np.any(person.covariance):
        yield _ellipse((x, y), person.covariance[:2, :2], {**common, "ns": "covariance"})


def prediction_markers(message: Predictions, head: Fields) -> Fields:
    """Return a MarkerArray: predicted path of each person, with 90 % ellipses."""
    markers = [one for person in message.people for one in _of_prediction(person, head)]
    return {"markers": markers}


def _of_prediction(person: PersonPrediction, head: Fields) -> Iterator[Fields]:
    common = {"header": head, "id": person.id, "lifetime": time(LIFETIME_NS)}
    path = np.vstack([person.position_m[:2], person.means_m]).tolist()
    yield {
        **common,
        "ns": "predicted_path",
        "type": LINES,
        "scale": xyz((0.04, 0.0, 0.0)),
        "color": _colour(person.id, 0.9),
        "points": [xyz((x, y, 0.03)) for x, y in path],
    }
    common["color"] = _colour(person.id, 0.12)
    for step, covariance in enumerate(person.covariances_m2, 1):
        x, y = path[step]
        yield _ellipse((x, y), covariance, {**common, "ns": f"predicted_{step}"})


def _ellipse(centre_m: tuple[float, float], covariance: F64, common: Fields) -> Fields:
    """Return the 90 % ellipse of a normal distribution on the floor, as a flat cylinder."""
    (a, b), (_, d) = covariance.tolist()
    middle, spread = (a + d) / 2, math.hypot((a - d) / 2, b)
    axes = (middle + spread, middle - spread)
    length, width = (2 * ELLIPSE_SIGMAS * math.sqrt(max(axis, 0.0)) for axis in axes)
    return {
        **common,
        "type": CYLINDER,
        "pose": pose((*centre_m, FLOOR_M), 0.5 * math.atan2(2 * b, a - d)),
        "scale": xyz((length, width, FLOOR_M)),
        "color": {**common["color"], "a": 0.4 * common["color"]["a"]},
    }


def _colour(number: int, alpha: float) -> Fields:
    """Return the std_msgs/ColorRGBA of an id."""
    hue = 6 * (number * GOLDEN % 1.0)
    red, green, blue = (0.3 + 0.7 * _ramp(hue, shift) for shift in (5, 3, 1))
    return {"r": red, "g": green, "b": blue, "a": alpha}


def _ramp(hue: float, shift: int) -> float:
    k = (shift + hue) % 6
    return 1.0 - max(0.0, min(k, 4 - k, 1.0))
