import math

import numpy as np
import pytest

from services.detector.position.axis import Ellipse, move_to_axis, relative_yaw, surface_to_axis

CHEST = Ellipse(half_depth_m=0.12, half_width_m=0.2)


def behind(yaw_rad: float | None, ellipse: Ellipse = CHEST) -> float:
    return surface_to_axis(yaw_rad, ellipse)


@pytest.mark.parametrize(("yaw_deg", "expected_m"), [(0, 0.12), (180, 0.12), (90, 0.2), (-90, 0.2)])
def test_the_middle_is_half_a_depth_before_the_axis_or_half_a_width(
    yaw_deg: float, expected_m: float
) -> None:
    assert behind(math.radians(yaw_deg)) == pytest.approx(expected_m)


def test_ellipse_at_45_degrees() -> None:
    # (r cos45 / 0.12)^2 + (r sin45 / 0.2)^2 = 1: r^2 (0.5 / 0.0144 + 0.5 / 0.04) = 1,
    # r = 1 / sqrt(34.722 + 12.5) = 0.14552.
    assert behind(math.radians(45)) == pytest.approx(0.14552, abs=1e-5)


def test_a_cylinder_is_as_far_from_any_side() -> None:
    cylinder = Ellipse(half_depth_m=0.15, half_width_m=0.15)
    for angle_rad in (None, 0.0, 0.7, 2.0, -3.0):
        assert behind(angle_rad, cylinder) == pytest.approx(0.15)


def test_opposite_yaw_changes_nothing() -> None:
    for angle_rad in (0.3, 1.2, 2.5):
        assert behind(angle_rad + math.pi) == pytest.approx(behind(angle_rad))


def test_torso_of_unknown_yaw_is_round_with_the_same_area() -> None:
    assert behind(None) == pytest.approx(math.sqrt(0.12 * 0.2))


def test_a_position_moves_along_its_ray() -> None:
    # Level distance hypot(3, 4) = 5: by half a depth of 0.12 that is 2.4 % farther. Facing away
    # along that ray: yaw = atan2(-3, 4).
    moved = move_to_axis(np.array([3.0, 1.0, 4.0]), math.atan2(-3, 4), CHEST)
    np.testing.assert_allclose(moved, [3.072, 1.024, 4.096])


def test_relative_yaw_counts_from_the_ray() -> None:
    assert relative_yaw(np.array([-1.0, 0.0, 1.0]), math.pi / 2) == pytest.approx(math.pi / 4)
    assert relative_yaw(np.array([-1.0, 0.0, 1.0]), None) is None
