"""Which way people face who walk."""

import numpy as np
import pytest

from people4d.messages import F64
from services.gait.points.facing import Facing
from services.gait.surface.mesh import Surface
from tests.gait.meshes import mesh_of

DT_S = 1 / 30
NOBODY = np.empty(0)


def person_at(x_m: float) -> tuple[Surface, F64]:
    """Three points of somebody whose feet are not seen, and how high they are."""
    heights_m = np.array([1.5, 1.0, 0.5])
    return mesh_of([(x_m, -h, 3.0) for h in heights_m - 1], [(0, 1), (1, 2)]), heights_m


def legs_towards(ahead_m: tuple[float, float]) -> tuple[Surface, F64]:
    """Thirty points of feet, in x and z ahead of as many of shins."""
    x, z = ahead_m
    rows = np.arange(30) / 1000
    shins = np.column_stack([rows, np.full(30, 0.8), np.full(30, 3.0)])
    feet = shins + np.array([x, 0.15, z])
    return mesh_of([*shins, *feet], [(0, 1)]), np.repeat([0.2, 0.05], 30)


def test_who_walks_faces_that_way() -> None:
    facing = Facing()
    for frame in range(30):
        told = facing.update(*person_at(-0.5 + frame * DT_S), DT_S)  # 1 m/s to the right
    assert told == pytest.approx([1.0, 0.0, 0.0])


def test_who_shows_no_feet_and_never_walked_faces_nobody_knows_where() -> None:
    facing = Facing()
    assert [facing.update(*person_at(0.0), DT_S) for _ in range(10)] == [None] * 10


@pytest.mark.parametrize(
    ("ahead_m", "expected"),
    [
        ((0.06, -0.03), (1.0, 0.0, 0.0)),  # to the right; of feet and shins the front is seen
        ((0.0, -0.09), (0.0, 0.0, -1.0)),  # towards the camera
        ((0.0, 0.03), (0.0, 0.0, 1.0)),  # away from it
    ],
)
def test_who_stands_faces_as_their_feet_point(
    ahead_m: tuple[float, float], expected: tuple[float, float, float]
) -> None:
    facing = Facing()
    for _ in range(60):
        told = facing.update(*legs_towards(ahead_m), DT_S)
    assert told == pytest.approx(expected, abs=0.15)


def test_who_stops_faces_on_and_whoever_appears_elsewhere_has_not_walked() -> None:
    facing = Facing()
    for frame in range(30):
        facing.update(*person_at(-0.5 + frame * DT_S), DT_S)
    facing.update(None, NOBODY, DT_S)  # hidden
    for _ in range(30):
        told = facing.update(*person_at(-1.0), DT_S)  # and 1.5 m to the left, where they stand
    assert told == pytest.approx([1.0, 0.0, 0.0])


def test_no_time_is_no_speed() -> None:
    facing = Facing()
    assert np.all([facing.update(*person_at(x), 0.0) is None for x in (0.0, 0.1, 0.2)])
