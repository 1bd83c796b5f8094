"""Heading of walking and standing people."""

import numpy as np
import pytest

from people4d.messages import F64
from services.gait.points.heading import HeadingEstimator
from services.gait.surface.mesh import BodyMesh
from tests.gait.builders import mesh_of

DT_S = 1 / 30
EMPTY = np.empty(0)


def person_at(x_m: float) -> tuple[BodyMesh, F64]:
    """Three points of a person with invisible feet, and their heights."""
    heights_m = np.array([1.5, 1.0, 0.5])
    return mesh_of([(x_m, -h, 3.0) for h in heights_m - 1], [(0, 1), (1, 2)]), heights_m


def legs_towards(ahead_m: tuple[float, float]) -> tuple[BodyMesh, F64]:
    """Thirty points of feet 15 cm wide, in x and z ahead of as many of shins."""
    x, z = ahead_m
    rows = np.arange(-15, 15) / 1000
    shins = np.column_stack([rows, np.full(30, 0.8), np.full(30, 3.0)])
    feet = shins * (5.0, 1.0, 1.0) + np.array([x, 0.15, z])
    return mesh_of([*shins, *feet], [(0, 1)]), np.repeat([0.2, 0.05], 30)


def test_heading_of_a_walking_person_is_the_direction_of_motion() -> None:
    heading = HeadingEstimator()
    for frame in range(30):
        found = heading.update_heading(*person_at(-0.5 + frame * DT_S), DT_S)  # 1 m/s to the right
    assert found == pytest.approx([1.0, 0.0, 0.0])


def test_heading_without_feet_and_motion_is_none() -> None:
    heading = HeadingEstimator()
    assert [heading.update_heading(*person_at(0.0), DT_S) for _ in range(10)] == [None] * 10


@pytest.mark.parametrize(
    ("ahead_m", "expected"),
    [
        ((0.06, -0.03), (1.0, 0.0, 0.0)),  # to the right; the front of feet and shins is visible
        ((0.0, -0.09), (0.0, 0.0, -1.0)),  # towards the camera
        ((0.0, 0.03), (0.0, 0.0, 1.0)),  # away from it
    ],
)
def test_heading_of_a_standing_person_is_that_of_the_feet(
    ahead_m: tuple[float, float], expected: tuple[float, float, float]
) -> None:
    heading = HeadingEstimator()
    for _ in range(60):
        found = heading.update_heading(*legs_towards(ahead_m), DT_S)
    assert found == pytest.approx(expected, abs=0.15)


def test_shin_of_a_leg_in_its_swing_does_not_turn_the_heading() -> None:
    # The other shin is 0.3 m aside, its foot lifted: the mean of both shins would be aside, too.
    mesh, heights_m = legs_towards((0.0, -0.09))
    other = mesh.points_m[:30] + np.array([0.3, 0.0, 0.0])
    both = mesh_of([*mesh.points_m, *other], [(0, 1)]), np.append(heights_m, np.repeat(0.2, 30))
    heading = HeadingEstimator()
    for _ in range(60):
        found = heading.update_heading(*both, DT_S)
    assert found == pytest.approx([0.0, 0.0, -1.0], abs=0.15)


def pose(x_m: float = 0.0, yaw_rad: float = 0.0) -> F64:
    """Pose of a camera that is moved to the right and turned about its vertical axis."""
    found = np.eye(4)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    found[:3, :3] = [(cos, 0.0, sin), (0.0, 1.0, 0.0), (-sin, 0.0, cos)]
    found[0, 3] = x_m
    return found


def test_standing_person_before_a_camera_that_drives_by_has_no_heading() -> None:
    heading = HeadingEstimator()
    for frame in range(30):
        driven_m = frame * DT_S  # 1 m/s to the right
        found = heading.update_heading(*person_at(-driven_m), DT_S, pose(x_m=driven_m))
    assert found is None


def test_heading_is_the_yaw_of_the_track_where_it_is_known() -> None:
    # The camera looks along x of the fixed frame: its left is y, -x of the optical frame.
    fixed = np.eye(4)
    fixed[:3, :3] = [(0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)]
    heading = HeadingEstimator()
    found = heading.update_heading(*person_at(0.0), DT_S, fixed, yaw_rad=np.pi / 2)
    assert found == pytest.approx([-1.0, 0.0, 0.0])
    assert heading.update_heading(*person_at(0.0), DT_S, fixed) == pytest.approx([-1.0, 0.0, 0.0])


def test_heading_turns_against_the_camera() -> None:
    heading = HeadingEstimator()
    for frame in range(30):
        heading.update_heading(*person_at(-0.5 + frame * DT_S), DT_S)  # to the right
    found = heading.update_heading(
        None, EMPTY, DT_S, pose(yaw_rad=np.pi / 2)
    )  # whence it went ahead
    assert found == pytest.approx([0.0, 0.0, 1.0])


def test_heading_persists_at_rest_and_over_a_jump_of_position() -> None:
    heading = HeadingEstimator()
    for frame in range(30):
        heading.update_heading(*person_at(-0.5 + frame * DT_S), DT_S)
    heading.update_heading(None, EMPTY, DT_S)  # occluded
    for _ in range(30):
        found = heading.update_heading(*person_at(-1.0), DT_S)  # and 1.5 m to the left, at rest
    assert found == pytest.approx([1.0, 0.0, 0.0])


def test_zero_time_gives_no_velocity() -> None:
    heading = HeadingEstimator()
    assert np.all([heading.update_heading(*person_at(x), 0.0) is None for x in (0.0, 0.1, 0.2)])
