import math

import numpy as np
import pytest

from services.detector.position.axis import Ellipse, move_to_axis, relative_yaw, surface_to_axis

CHEST = Ellipse(half_depth_m=0.12, half_width_m=0.2)


def behind(right_m: float, yaw_rad: float | None, ellipse: Ellipse = CHEST) -> float:
    return surface_to_axis([right_m], yaw_rad, ellipse)[0]


@pytest.mark.parametrize(("yaw_deg", "expected_m"), [(0, 0.12), (180, 0.12), (90, 0.2), (-90, 0.2)])
def test_the_middle_is_half_a_depth_before_the_axis_or_half_a_width(
    yaw_deg: float, expected_m: float
) -> None:
    assert behind(0.0, math.radians(yaw_deg)) == pytest.approx(expected_m)


def test_ellipse_at_45_degrees() -> None:
    # (r cos45 / 0.12)^2 + (r sin45 / 0.2)^2 = 1: r^2 (0.5 / 0.0144 + 0.5 / 0.04) = 1,
    # r = 1 / sqrt(34.722 + 12.5) = 0.14552.
    assert behind(0.0, math.radians(45)) == pytest.approx(0.14552, abs=1e-5)


def test_a_cylinder_is_as_far_from_any_side() -> None:
    # x^2 + y^2 = 0.15^2: 0.09 to the right it is sqrt(0.0225 - 0.0081) = 0.12 deep.
    cylinder = Ellipse(half_depth_m=0.15, half_width_m=0.15)
    for angle_rad in (None, 0.0, 0.7, 2.0, -3.0):
        assert behind(0.09, angle_rad, cylinder) == pytest.approx(0.12)


def test_points_beside_the_middle_are_less_deep() -> None:
    # Seen from the front, (x / 0.2)^2 + (y / 0.12)^2 = 1: at x = 0.12, y = 0.12 * 0.8.
    assert behind(0.12, math.pi) == pytest.approx(0.096)
    assert behind(-0.12, math.pi) == pytest.approx(0.096)


def test_a_person_facing_left_and_away_is_nearer_on_their_left() -> None:
    # Turned by 45 degrees to the left, the right shoulder points to the right and away, the left
    # one to the left and to the camera: the surface on the left is nearer to the camera.
    assert behind(-0.08, math.radians(45)) > behind(0.08, math.radians(45))


def test_a_point_beyond_the_outline_counts_as_one_near_it() -> None:
    # Seen from the front the outline is at 0.2: beyond 0.18, y = 0.12 sqrt(1 - 0.81) = 0.052307.
    assert behind(5.0, 0.0) == pytest.approx(0.052307, abs=1e-6)


def test_opposite_yaw_changes_nothing() -> None:
    for right_m in (-0.1, 0.0, 0.1):
        for angle_rad in (0.3, 1.2, 2.5):
            same = behind(right_m, angle_rad + math.pi)
            assert behind(right_m, angle_rad) == pytest.approx(same)


def test_torso_of_unknown_yaw_is_round_with_the_same_area() -> None:
    assert behind(0.0, None) == pytest.approx(math.sqrt(0.12 * 0.2))


def test_a_position_moves_along_its_ray() -> None:
    # Level distance hypot(3, 4) = 5: by half a depth of 0.12 that is 2.4 % farther. Facing away
    # along that ray: yaw = atan2(-3, 4).
    moved = move_to_axis(np.array([3.0, 1.0, 4.0]), math.atan2(-3, 4), CHEST)
    np.testing.assert_allclose(moved, [3.072, 1.024, 4.096])


def test_relative_yaw_counts_from_the_ray() -> None:
    assert relative_yaw(np.array([-1.0, 0.0, 1.0]), math.pi / 2) == pytest.approx(math.pi / 4)
    assert relative_yaw(np.array([-1.0, 0.0, 1.0]), None) is None
