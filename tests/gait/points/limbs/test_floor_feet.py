"""Feet beyond the range of depth, on a floor 1.2 m below a level camera."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from common.geometry.transforms import project
from people4d.messages import F64, U16
from services.gait.points.body import MeshObservation
from services.gait.points.keypoints import Anchor
from services.gait.points.limbs.floor_feet import correct_by_floor, floor_positions
from services.gait.points.limbs.surface import SurfacePosition
from services.gait.points.normal import Normal
from services.gait.points.point_filter import PointFilter
from services.gait.surface.floor import FloorPlane
from tests.gait.builders import INFO

UP = np.array([0.0, -1.0, 0.0])
AHEAD = np.array([1.0, 0.0, 0.0])
FLOOR = FloorPlane(UP, 1.2)
STANDING = np.array([0.3, 1.08, 5.2])  # an ankle 0.12 m above the floor


def foot() -> PointFilter:
    return PointFilter("left_foot")


def ankle_at(position_m: F64, confidence: float = 0.7) -> Anchor:
    pixel = project(position_m, INFO)[0]
    return Anchor(pixel, 1.0, confidence, pixel)


def depth(readings: int = 0) -> U16:
    """No readings, but for some rows of the image about the ankle."""
    image = np.zeros((INFO.height, INFO.width), np.uint16)
    row = int(project(STANDING, INFO)[0, 1])
    image[row - readings : row + readings] = 4900
    return image


def found(
    anchor: Anchor, depth_mm: U16, floor: FloorPlane | None = FLOOR, prior: Normal | None = None
) -> Mapping[str, SurfacePosition]:
    point = foot()
    point.prior = prior
    observation = MeshObservation(None, 0.05, floor=floor, depth_mm=depth_mm)
    return floor_positions({"left_foot": anchor}, {"left_foot": point}, observation, AHEAD, INFO)


def test_standing_foot_is_where_the_ray_of_its_ankle_meets_that_height() -> None:
    one = found(ankle_at(STANDING), depth())["left_foot"]
    # The middle of the foot is 8 cm ahead of the ankle and 3 cm below it.
    assert one.position_m == pytest.approx(STANDING + 0.08 * AHEAD - 0.03 * UP, abs=1e-6)
    ray = one.position_m / np.linalg.norm(one.position_m)
    assert ray @ one.noise_m2 @ ray == pytest.approx(0.06**2 + 0.15**2, abs=1e-6)


def test_ankle_with_depth_about_it_is_not_put_on_the_floor() -> None:
    assert found(ankle_at(STANDING), depth(readings=3)) == {}


@pytest.mark.parametrize(
    ("anchor", "floor"),
    [
        pytest.param(ankle_at(STANDING), None, id="no floor"),
        pytest.param(ankle_at(STANDING, 0.2), FLOOR, id="uncertain keypoint"),
        pytest.param(ankle_at(np.array([0.3, -0.2, 5.0])), FLOOR, id="above the camera"),
        pytest.param(ankle_at(np.array([0.3, 1.08, 9.0])), FLOOR, id="too far"),
        pytest.param(ankle_at(np.array([9.0, 1.08, 5.0])), FLOOR, id="beside the image"),
    ],
)
def test_foot_without_floor_or_ankle_has_no_position(
    anchor: Anchor, floor: FloorPlane | None
) -> None:
    assert found(anchor, depth(), floor) == {}


def test_foot_farther_than_the_body_expects_counts_less() -> None:
    lifted = STANDING + 0.1 * UP
    prior = Normal(lifted, 0.1**2 * np.eye(3))
    one = found(ankle_at(lifted), depth(), prior=prior)["left_foot"]
    # The foot appears 1.08 / 0.98 times as far, 0.53 m too far. Half of this adds to 0.15 m along
    # the ray.
    ray = one.position_m / np.linalg.norm(one.position_m)
    along_m = float(np.sqrt(ray @ one.noise_m2 @ ray - 0.06**2))
    assert along_m == pytest.approx(np.hypot(0.15, 0.5 * 0.53), abs=0.01)


def test_foot_on_the_floor_is_predicted_and_not_lost() -> None:
    point = foot()
    one = found(ankle_at(STANDING), depth())["left_foot"]
    point.start_beside(one.position_m, one.noise_m2)
    for _ in range(100):
        assert point.motion is not None
        point.motion.predict(0.05)
        correct_by_floor(point, one, 0.05)
    estimate = point.estimate()
    assert estimate.state == "predicted"
    assert estimate.position_m == pytest.approx(one.position_m, abs=0.01)


def test_floor_far_from_the_prediction_does_not_count() -> None:
    point = foot()
    one = found(ankle_at(STANDING), depth())["left_foot"]
    point.start_beside(one.position_m, one.noise_m2)
    far = replace(one, position_m=one.position_m + 2.0 * AHEAD)
    correct_by_floor(point, far, 0.05)
    assert point.estimate().position_m == pytest.approx(one.position_m, abs=1e-6)
    assert point.missed_s == pytest.approx(0.05)
