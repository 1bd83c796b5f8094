"""Chains of transforms, worked by hand."""

import itertools
import math

import numpy as np
import pytest

from common.geometry.frame_graph import FrameGraph
from common.geometry.transforms import LINK_FROM_OPTICAL, apply, rotation_from_rpy, transform_from
from people4d.messages import F64, StaticTransform
from tests import builders


def transform(parent: str, child: str, matrix: F64) -> StaticTransform:
    return builders.static_transform(matrix, parent=parent, child=child)


def shift(x: float, y: float = 0.0, z: float = 0.0) -> F64:
    return transform_from([x, y, z], np.eye(3))


def graph(*transforms: StaticTransform) -> FrameGraph:
    made = FrameGraph()
    for one in transforms:
        made.add_transform(one)
    return made


def test_a_chain_is_followed_in_both_directions() -> None:
    turn = transform_from([0.0, 1.0, 0.0], rotation_from_rpy(0, 0, math.pi / 2))
    frames = graph(transform("map", "mocap", turn), transform("mocap", "camera_link", shift(2.0)))
    # The camera is 2 m along mocap's x, which is map's y: (0, 1) + (0, 2).
    map_from_camera = frames.lookup("map", "camera_link")
    assert map_from_camera is not None
    assert apply(map_from_camera, [0.0, 0.0, 0.0]) == pytest.approx(np.array([0.0, 3.0, 0.0]))
    camera_from_map = frames.lookup("camera_link", "map")
    assert camera_from_map is not None
    assert camera_from_map @ map_from_camera == pytest.approx(np.eye(4))


def test_a_frame_in_itself_and_frames_that_are_not_linked() -> None:
    frames = graph(transform("map", "mocap", shift(1.0)))
    assert frames.lookup("x", "x") == pytest.approx(np.eye(4))
    assert frames.lookup("map", "x") is None
    assert FrameGraph().lookup("map", "mocap") is None


def test_mocap_that_measured_the_camera_is_found_through_it() -> None:
    # The camera service publishes map <- optical; motion capture measured the camera's body, 2 m
    # along its own x. In the map the camera is at (1, 0, 1.5), so the origin of mocap is at (-1, 0,
    # 1.5).
    frames = graph(
        transform("map", "camera_optical_frame", shift(1.0, 0.0, 1.5) @ LINK_FROM_OPTICAL),
        transform("mocap", "camera_link", shift(2.0)),
    )
    map_from_mocap = frames.lookup("map", "mocap")
    assert map_from_mocap is not None
    assert map_from_mocap == pytest.approx(shift(-1.0, 0.0, 1.5))


def test_transforms_of_the_link_win_over_the_rule() -> None:
    # This vendor places the link 1.5 cm from the lens.
    frames = graph(
        transform("camera_link", "camera_optical_frame", shift(0, 0.015) @ LINK_FROM_OPTICAL),
        transform("map", "camera_link", shift(1.0)),
    )
    got = frames.lookup("map", "camera_optical_frame")
    assert got is not None
    assert got[:3, 3] == pytest.approx(np.array([1.0, 0.015, 0.0]))


def test_a_newer_transform_replaces_the_older() -> None:
    frames = graph(transform("map", "a", shift(1.0)), transform("map", "a", shift(5.0)))
    got = frames.lookup("map", "a")
    assert got is not None
    assert got[0, 3] == 5.0


def test_paths_asked_for_in_between_change_nothing() -> None:
    generator = np.random.default_rng(5)
    names = ["map", "base", "a", "b", "c", "front_link", "front_optical_frame", "d", "e"]
    for _ in range(50):
        asked, fresh = FrameGraph(), FrameGraph()
        for parent, child in generator.choice(names, (6, 2)):
            if parent == child:
                continue
            asked.link(parent, child, np.eye(4))
            fresh.link(parent, child, np.eye(4))  # requested at the end only
            for source in names:
                asked.path("map", source)
        for target, source in itertools.permutations(names, 2):
            found, expected = asked.path(target, source), fresh.path(target, source)
            assert (found and list(found)) == (expected and list(expected))
