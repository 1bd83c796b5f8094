"""People and predictions for RViz: visualization_msgs."""

import math
from collections.abc import Iterator

import numpy as np

from common.ros2.messages.basic import header, pose, time, xyz, yaw_quaternion
from common.ros2.messages.person import RosPeople, RosPerson
from common.ros2.types import Fields
from people4d.messages import F64
from people4d.messages.prediction import PersonPrediction, Predictions

MARKERS = "visualization_msgs/msg/MarkerArray"

# visualization_msgs/Marker
ARROW, CUBE, CYLINDER, LINES, TEXT = 0, 1, 3, 4, 9

ELLIPSE_SIGMAS = 2.146  # half axes that hold 90 % of a plane's normal distribution
GOLDEN = 0.618033988749895  # its multiples spread hues, whatever the ids
LIFETIME_NS = 500_000_000
FLOOR_M = 0.01  # [m] thickness and height of what lies on the floor


def people_markers(message: RosPeople, size_m: tuple[float, float, float]) -> Fields:
    """Return a MarkerArray: of each person a box, its heading, speed, id and 90 % ellipse."""
    head = header(message.stamp_ns, message.frame_id)
    markers = [one for person in message.people for one in _of_person(person, head, size_m)]
    return {"markers": markers}


def _of_person(
    person: RosPerson, head: Fields, size_m: tuple[float, float, float]
) -> Iterator[Fields]:
    (x, y, _), height_m = person.position_m, size_m[2]
    colour = _colour(person.id, 0.35 if person.state == "lost" else 0.8)
    common = {"header": head, "id": person.id, "lifetime": time(LIFETIME_NS)}
    yield {
        **common,
        "ns": "box",
        "type": CUBE,
        "pose": pose((x, y, height_m / 2), person.yaw_rad),
        "scale": xyz(size_m),
        "color": colour,
    }
    if person.yaw_known:
        yield {
            **common,
            "ns": "heading",
            "type": ARROW,
            "pose": pose((x, y, 0.75 * height_m), person.yaw_rad),
            "scale": xyz((0.6, 0.06, 0.06)),
            "color": colour,
        }
    if person.moves:
        vx, vy, _ = person.velocity_mps
        yield {
            **common,
            "ns": "velocity",
            "type": ARROW,
            "pose": pose((x, y, 0.05), math.atan2(vy, vx)),
            "scale": xyz((math.hypot(vx, vy), 0.05, 0.05)),
            "color": colour,
        }
    yield {
        **common,
        "ns": "id",
        "type": TEXT,
        "pose": pose((x, y, height_m + 0.15), 0.0),
        "scale": xyz((0.0, 0.0, 0.25)),
        "color": _colour(person.id, 1.0),
        "text": person.name,
    }
    if np.any(person.covariance):
        yield _ellipse((x, y), person.covariance[:2, :2], {**common, "ns": "covariance"}, colour)


def prediction_markers(message: Predictions, head: Fields) -> Fields:
    """Return a MarkerArray: of each person the predicted path, and 90 % ellipses along it."""
    markers = [one for person in message.people for one in _of_prediction(person, head)]
    return {"markers": markers}


def _of_prediction(person: PersonPrediction, head: Fields) -> Iterator[Fields]:
    common = {"header": head, "lifetime": time(LIFETIME_NS)}
    path = np.vstack([person.position_m[:2], person.means_m]).tolist()
    yield {
        **common,
        "ns": "predicted_path",
        "id": person.id,
        "type": LINES,
        "scale": xyz((0.04, 0.0, 0.0)),
        "color": _colour(person.id, 0.9),
        "points": [xyz((x, y, 0.03)) for x, y in path],
    }
    for step, covariance in enumerate(person.covariances_m2):
        marked = {**common, "ns": f"predicted_{step + 1}", "id": person.id}
        x, y = path[step + 1]
        yield _ellipse((x, y), covariance, marked, _colour(person.id, 0.12))


def _ellipse(
    centre_m: tuple[float, float], covariance: F64, common: Fields, colour: Fields
) -> Fields:
    """Return a flat cylinder that holds 90 % of a normal distribution on the floor."""
    (a, b), (_, d) = covariance.tolist()
    middle, spread = (a + d) / 2, math.hypot((a - d) / 2, b)
    axes = (middle + spread, middle - spread)
    length, width = (2 * ELLIPSE_SIGMAS * math.sqrt(max(axis, 0.0)) for axis in axes)
    return {
        **common,
        "type": CYLINDER,
        "pose": {
            "position": xyz((*centre_m, FLOOR_M)),
            "orientation": yaw_quaternion(0.5 * math.atan2(2 * b, a - d)),
        },
        "scale": xyz((length, width, FLOOR_M)),
        "color": {**colour, "a": 0.4 * colour["a"]},
    }


def _colour(number: int, alpha: float) -> Fields:
    """Return a std_msgs/ColorRGBA that an id always has."""
    hue = 6 * (number * GOLDEN % 1.0)
    red, green, blue = (0.3 + 0.7 * _ramp(hue, shift) for shift in (5, 3, 1))
    return {"r": red, "g": green, "b": blue, "a": alpha}


def _ramp(hue: float, shift: int) -> float:
    k = (shift + hue) % 6
    return 1.0 - max(0.0, min(k, 4 - k, 1.0))
