"""Transforms of a bag."""

import math

import pytest

from common.ros2.transforms import edges_of
from services.camera.ros.motion import FrameTree
from tests.camera.ros.bags import Ros

ROS = Ros(2)
NO_TURN = (0, 0, 0, 1)
LEFT_90 = (0, 0, math.sqrt(0.5), math.sqrt(0.5))


def tree(*items: tuple[str, str, tuple[float, float, float], tuple[float, ...]]) -> FrameTree:
    transforms = FrameTree()
    for item in items:
        for edge in edges_of(ROS.transform(*item)):
            transforms.add_transform(edge.parent, edge.child, edge.matrix)
    return transforms


def test_siblings_meet_in_their_parent() -> None:
    # Colour stands at (1, 0, 0) of base and looks left, depth at (1, 1, 0) and looks ahead. From
    # colour, depth is 1 m along base's y, which is colour's x: (1, 0, 0). And base's x is
    # colour's -y: a point 2 m ahead of depth is at (1, -2, 0).
    both = tree(("base", "colour", (1, 0, 0), LEFT_90), ("/base", "/depth", (1, 1, 0), NO_TURN))
    matrix = both.find_transform("colour", "depth")
    assert matrix is not None
    assert (matrix @ (0, 0, 0, 1))[:3] == pytest.approx([1, 0, 0])
    assert (matrix @ (2, 0, 0, 1))[:3] == pytest.approx([1, -2, 0])


def test_frames_without_connection() -> None:
    parts = tree(("a", "b", (1, 0, 0), NO_TURN), ("c", "d", (1, 0, 0), NO_TURN))
    assert parts.find_transform("a", "d") is None
    assert parts.find_transform("map", "b") is None


def test_loops_and_transforms_that_are_none_do_no_harm() -> None:
    odd = tree(
        ("a", "b", (1, 0, 0), NO_TURN),
        ("b", "a", (1, 0, 0), NO_TURN),
        ("c", "d", (0, 0, 0), (0, 0, 0, 0)),
        ("c", "e", (math.nan, 0, 0), NO_TURN),
    )
    assert (
        odd.find_transform("a", "b") is not None
    )  # the direction does not matter: the search ends
    assert odd.find_transform("x", "b") is None
    assert odd.find_transform("c", "d") is None
    assert odd.find_transform("c", "e") is None
