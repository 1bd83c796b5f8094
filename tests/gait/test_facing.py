"""Which way people face who walk."""

import numpy as np
import pytest

from services.gait.depth_config import DepthLayerConfig
from services.gait.facing import Facing
from services.gait.surface import Surface
from tests.gait.meshes import mesh_of

DT_S = 1 / 30


def person_at(x_m: float) -> Surface:
    return mesh_of([(x_m, y, 3.0) for y in (-0.5, 0.0, 0.5)], [(0, 1), (1, 2)])


def test_who_walks_faces_that_way() -> None:
    facing = Facing(DepthLayerConfig(walk_mps=0.3))
    for frame in range(30):
        told = facing.update(person_at(-0.5 + frame * DT_S), DT_S)  # 1 m/s to the right
    assert told == pytest.approx([1.0, 0.0, 0.0])


def test_who_never_walked_faces_nobody_knows_where() -> None:
    facing = Facing(DepthLayerConfig(walk_mps=0.3))
    assert [facing.update(person_at(0.0), DT_S) for _ in range(10)] == [None] * 10


def test_who_stops_faces_on_and_whoever_appears_elsewhere_has_not_walked() -> None:
    facing = Facing(DepthLayerConfig(walk_mps=0.3))
    for frame in range(30):
        facing.update(person_at(-0.5 + frame * DT_S), DT_S)
    facing.update(None, DT_S)  # hidden
    for _ in range(30):
        told = facing.update(person_at(-1.0), DT_S)  # and 1.5 m to the left, where they stand
    assert told == pytest.approx([1.0, 0.0, 0.0])


def test_no_time_is_no_speed() -> None:
    facing = Facing(DepthLayerConfig(walk_mps=0.3))
    assert np.all([facing.update(person_at(x), 0.0) is None for x in (0.0, 0.1, 0.2)])
