"""What a mesh tells of limbs, on bodies of a few vertices."""

import numpy as np
import pytest

from services.gait.points.config import DepthLayerConfig
from services.gait.points.limbs import (
    Body3d,
    body_of,
    heights_of,
    kinds_of,
    limb_ends,
    trunk_vertices,
)
from services.gait.surface.floor import Floor
from services.gait.surface.geodesic import geodesic_m
from services.gait.surface.tips import tips_of
from tests.gait.meshes import mesh_of

CONFIG = DepthLayerConfig(hand_m=0.09, window_m=0.06, tip_m=0.06)
STATURE_M = 1.8


def arm() -> Body3d:
    """A trunk of 20 cm, and from its middle an arm of 60 cm to the right, a vertex every 3 cm."""
    trunk = [(0.0, y, 2.0) for y in (-0.1, 0.0, 0.1)]
    hand = [(0.03 * k, 0.0, 2.0) for k in range(1, 21)]
    surface = mesh_of(
        [*trunk, *hand], [(0, 1), (1, 2), (1, 3), *((k, k + 1) for k in range(3, 22))]
    )
    heights_m = np.full(23, 1.2)
    along_m = geodesic_m(surface, 1)
    tips = tips_of(surface, along_m, CONFIG.tip_m)
    return body_of(surface, heights_m, STATURE_M, along_m, tips)


def test_heights_are_above_the_floor_or_above_what_is_lowest() -> None:
    # y points down; the camera is 1.2 m above the floor.
    surface = mesh_of([(0.0, -0.5, 2.0), (0.0, 0.7, 2.0)], [(0, 1)])
    floor = Floor(up=np.array([0.0, -1.0, 0.0]), camera_m=1.2)
    assert heights_of(surface, floor) == pytest.approx([1.7, 0.5])
    assert heights_of(surface, None) == pytest.approx([1.2, 0.0])


def test_the_trunk_is_from_the_loins_to_the_armpits() -> None:
    # Of 2 m: from 1.1 to 1.6 m.
    assert trunk_vertices(np.array([0.5, 1.2, 1.5, 1.9]), 2.0).tolist() == [1, 2]
    assert trunk_vertices(np.array([0.5, 0.6]), 2.0).tolist() == [0, 1]  # of none, all


def test_low_ends_are_feet_and_the_highest_in_the_middle_is_the_head() -> None:
    # Of 1.8 m: feet are below 0.25 m, heads above 1.48 m. A hand is raised as high, but aside.
    places = [(0.1, 0.9, 2.0), (-0.1, 0.9, 2.0), (0.0, -0.8, 2.0), (0.6, -0.8, 2.0), (0.3, 0, 2.0)]
    surface = mesh_of([*places, (0.0, 0.2, 2.0), (0.01, 0.1, 2.0)], [(0, 1)])
    heights_m = np.array([0.1, 0.1, 1.75, 1.76, 0.9, 0.7, 0.8])
    kinds = kinds_of(np.arange(5), surface, heights_m, STATURE_M)
    assert kinds == ("foot", "foot", "head", "hand", "hand")


def test_a_hand_lies_its_length_before_the_end_of_the_arm() -> None:
    # The fingertips are 60 cm along; 9 cm before them is the middle of the last 18.
    body = arm()
    (end,) = [end for end in limb_ends(body, CONFIG) if end.kind == "hand"]
    assert end.along_m == pytest.approx(0.6)
    assert end.position_m == pytest.approx([0.51, 0.0, 2.0])
    assert end.strength == 1.0  # it stands out by more than 20 cm


def test_vertices_know_how_far_their_limb_goes_on() -> None:
    body = arm()
    assert body.below_m[22] == pytest.approx(0.0)  # the fingertips
    assert body.below_m[12] == pytest.approx(0.3)  # ten vertices before them


def test_what_ends_near_the_trunk_is_no_hand() -> None:
    # An elbow 24 cm from the trunk's middle; hands are beyond 30 cm.
    surface = mesh_of([(0.03 * k, 0.0, 2.0) for k in range(9)], [(k, k + 1) for k in range(8)])
    along_m = geodesic_m(surface, 0)
    body = body_of(surface, np.full(9, 1.2), STATURE_M, along_m, tips_of(surface, along_m, 0.06))
    assert body.kinds == ("hand",)
    assert limb_ends(body, CONFIG) == []
