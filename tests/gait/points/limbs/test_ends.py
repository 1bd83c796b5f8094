"""Hands and feet at the ends of bent limbs, turned and mirrored."""

import numpy as np

from people4d.messages import F64
from services.gait.points.body import Extremity, MeasuredBody, find_extremities, measure_body
from services.gait.points.limbs.ends import end_position
from services.gait.surface.geodesic import geodesic_extrema, geodesic_m
from tests.gait.builders import mesh_of

UP = np.array([0.0, -1.0, 0.0])
AWAY = np.array([0.0, 0.0, 1.0])
STEP_M = 0.02


def leg(foot: F64) -> tuple[MeasuredBody, Extremity]:
    """A leg of 0.8 m straight down, 3 m away, with a foot of 0.2 m in some direction (3)."""
    shank = [np.array([0.0, 0.05 + STEP_M * k, 3.0]) for k in range(40)]
    points_m = np.array([*shank, *(shank[-1] + STEP_M * k * foot for k in range(1, 11))])
    count = len(points_m)
    # Each vertex has a neighbour beside it, because slices have three vertices and more.
    wide_m = np.concatenate([points_m, points_m + np.array([STEP_M, 0.0, 0.0])])
    edges = [(k, k + 1) for k in range(count - 1)] + [(k, k + count) for k in range(count)]
    mesh = mesh_of(wide_m, edges)
    heights_m = wide_m[:, 1].max() - wide_m[:, 1] + 0.04
    distances_m = geodesic_m(mesh, 0)
    extrema = geodesic_extrema(mesh, distances_m, 0.06)
    body = measure_body(mesh, heights_m, 1.7, distances_m, extrema)
    (end,) = (one for one in find_extremities(body) if one.kind == "foot")
    return body, end


def test_foot_is_ahead_of_the_heel_of_a_leg_that_points_away() -> None:
    # The end of the leg is the heel: it hides the surface of the foot behind it.
    body, end = leg(0.1 * AWAY + 0.3 * UP)
    found = end_position("left_foot", end, body, AWAY, UP)
    assert found is not None
    assert (found.position_m - end.position_m) @ AWAY > 0.03


def test_foot_at_the_toes_hardly_moves() -> None:
    toes = np.array([0.98, 0.2, 0.0])
    body, end = leg(toes)
    found = end_position("right_foot", end, body, np.array([1.0, 0.0, 0.0]), UP)
    assert found is not None
    assert np.linalg.norm(found.position_m - end.position_m) < 0.08
    assert found.vertex == body.mesh.nearest(end.position_m)


def test_left_and_right_mirror_each_other() -> None:
    # A leg in the plane of heading and up is symmetric: its mirror image is the same.
    body, end = leg(0.3 * UP - 0.9 * AWAY)
    both = [end_position(name, end, body, -AWAY, UP) for name in ("left_foot", "right_foot")]
    offsets = [one.position_m - end.position_m for one in both if one]
    assert len(offsets) == 2
    np.testing.assert_allclose(offsets[0][1:], offsets[1][1:], atol=0.01)


def test_without_heading_or_end_there_is_no_position() -> None:
    body, end = leg(0.1 * AWAY + 0.3 * UP)
    assert end_position("left_foot", None, body, AWAY, UP) is None
    assert end_position("left_foot", end, body, None, UP) is None
