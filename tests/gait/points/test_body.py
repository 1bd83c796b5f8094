"""Measurements of bodies of a few vertices."""

import numpy as np
import pytest

from services.gait.points.body import (
    MeasuredBody,
    extremity_kinds,
    find_extremities,
    heights_of,
    measure_body,
    torso_vertices,
)
from services.gait.surface.floor import FloorPlane
from services.gait.surface.geodesic import geodesic_extrema, geodesic_m
from tests.gait.builders import mesh_of

STATURE_M = 1.8


def arm() -> MeasuredBody:
    """A torso of 20 cm, and from its middle an arm of 60 cm to the right, a vertex every 3 cm."""
    torso = [(0.0, y, 2.0) for y in (-0.1, 0.0, 0.1)]
    hand = [(0.03 * k, 0.0, 2.0) for k in range(1, 21)]
    mesh = mesh_of([*torso, *hand], [(0, 1), (1, 2), (1, 3), *((k, k + 1) for k in range(3, 22))])
    heights_m = np.full(23, 1.2)
    distance_m = geodesic_m(mesh, 1)
    extrema = geodesic_extrema(mesh, distance_m)
    return measure_body(mesh, heights_m, STATURE_M, distance_m, extrema)


def test_heights_are_above_the_floor_or_the_lowest_vertex() -> None:
    # y points down; the camera is 1.2 m above the floor.
    mesh = mesh_of([(0.0, -0.5, 2.0), (0.0, 0.7, 2.0)], [(0, 1)])
    floor = FloorPlane(up=np.array([0.0, -1.0, 0.0]), camera_m=1.2)
    assert heights_of(mesh, floor) == pytest.approx([1.7, 0.5])
    assert heights_of(mesh, None) == pytest.approx([1.2, 0.0])


def test_torso_is_from_the_loins_to_the_armpits() -> None:
    # Of 2 m: from 1.1 to 1.6 m.
    assert torso_vertices(np.array([0.5, 1.2, 1.5, 1.9]), 2.0).tolist() == [1, 2]
    assert torso_vertices(np.array([0.5, 0.6]), 2.0).tolist() == [0, 1]  # of none, all


def test_extrema_are_classified_by_height() -> None:
    # Of 1.8 m: feet are below 0.25 m, heads above 1.48 m. A hand is raised as high, but aside.
    positions = [
        (0.1, 0.9, 2.0),
        (-0.1, 0.9, 2.0),
        (0.0, -0.8, 2.0),
        (0.6, -0.8, 2.0),
        (0.3, 0, 2.0),
    ]
    mesh = mesh_of([*positions, (0.0, 0.2, 2.0), (0.01, 0.1, 2.0)], [(0, 1)])
    heights_m = np.array([0.1, 0.1, 1.75, 1.76, 0.9, 0.7, 0.8])
    kinds = extremity_kinds(np.arange(5), mesh, heights_m, STATURE_M)
    assert kinds == ("foot", "foot", "head", "hand", "hand")


def test_hand_position_is_one_hand_length_before_the_fingertips() -> None:
    # The fingertips are 60 cm along; 9 cm before them is the middle of the last 18.
    body = arm()
    (one,) = [one for one in find_extremities(body) if one.kind == "hand"]
    assert one.geodesic_m == pytest.approx(0.6)
    assert one.position_m == pytest.approx([0.51, 0.0, 2.0])
    assert one.strength == 1.0  # of a persistence above 20 cm


def test_tip_distance_of_vertices_is_geodesic() -> None:
    body = arm()
    assert body.tip_distance_m[22] == pytest.approx(0.0)  # the fingertips
    assert body.tip_distance_m[12] == pytest.approx(0.3)  # ten vertices before these


def test_extremum_near_the_torso_is_no_hand() -> None:
    # An elbow 24 cm from the torso's middle; hands are beyond 30 cm.
    mesh = mesh_of([(0.03 * k, 0.0, 2.0) for k in range(9)], [(k, k + 1) for k in range(8)])
    distance_m = geodesic_m(mesh, 0)
    body = measure_body(
        mesh, np.full(9, 1.2), STATURE_M, distance_m, geodesic_extrema(mesh, distance_m)
    )
    assert body.kinds == ("hand",)
    assert find_extremities(body) == []
