"""Tracks in the frame of a moving base equal transformed tracks in the map."""

import math

import numpy as np
import pytest

from common.geometry.transform_buffer import TransformBuffer, transform_from_odometry
from common.geometry.transform_history import TransformEstimate
from common.geometry.transforms import (
    LINK_FROM_OPTICAL,
    apply,
    invert,
    rotation_from_rpy,
    transform_from,
)
from people4d.messages import F64, Detection, Detections, Message, Odometry, StaticTransform, Tracks
from services.tracker.build import build
from services.tracker.cameras.poses import transform_track
from tests import builders
from tests.tracker.scene import published_config

CAMERA = "front_optical_frame"
STEP_NS = 100_000_000
MOUNT = transform_from([0.2, 0.0, 1.0], LINK_FROM_OPTICAL[:3, :3])
STANDING, WALKING = np.array([4.0, 0.5, 1.0]), np.array([3.5, -1.0, 1.0])


def fixed(parent: str, child: str, matrix: F64) -> StaticTransform:
    return builders.static_transform(matrix, parent=parent, child=child)


def driven(number: int) -> Odometry:
    """A robot that weaves: 0.3 m/s forward, up to 50 degrees a second to either side."""
    t = number / 10
    return builders.odometry(
        stamp_ns=number * STEP_NS,
        sequence=number,
        x_m=0.3 * t,
        y_m=0.05 * math.sin(t),
        theta_rad=0.35 * math.sin(2.5 * t),
    )


def detected(number: int) -> Detections:
    """A standing person, and one walking along y at 0.5 m/s, both measured without error."""
    optical_from_odom = invert(transform_from_odometry(driven(number)) @ MOUNT)
    people = []
    for position_m in (STANDING, WALKING + np.array([0.0, 0.05 * number, 0.0])):
        x, y, z = apply(optical_from_odom, position_m)
        u = 320 + 500 * x / z
        box = np.array([u - 60, 100.0, u + 60, 400.0], np.float32)
        people.append(Detection(box_xyxy_px=box, score=0.9, position_m=np.array([x, y, z])))
    return builders.detections(*people, stamp_ns=number * STEP_NS, sequence=number, frame_id=CAMERA)


def run(frame_id: str, *transforms: Message) -> list[Tracks]:
    config = published_config(frame_id=frame_id, embedding_wait_s=0.0)
    node = build(config)
    outputs: list[Message] = []
    for message in (*transforms, fixed("base_link", CAMERA, MOUNT)):
        outputs += node.handle(message, 0)
    for number in range(40):
        outputs += node.handle(driven(number), 0)
        outputs += node.handle(detected(number), 0)
    return [message for message in outputs if isinstance(message, Tracks)]


def test_tracks_in_the_base_equal_those_in_the_map() -> None:
    map_from_odom = transform_from([2.0, 1.0, 0.0], rotation_from_rpy(0.0, 0.0, 0.7))
    in_map, in_base = run("map", fixed("map", "odom", map_from_odom)), run("base_link")
    assert len(in_map) == len(in_base) == 40
    assert {tracks.frame_id for tracks in in_base} == {"base_link"}
    for number, (there, here) in enumerate(zip(in_map, in_base, strict=True)):
        base_from_map = invert(map_from_odom @ transform_from_odometry(driven(number)))
        for a, b in zip(there.tracks, here.tracks, strict=True):
            expected = transform_track(a, TransformEstimate(base_from_map))
            assert b.id == a.id
            np.testing.assert_allclose(b.position_m, expected.position_m, atol=1e-9)
            np.testing.assert_allclose(b.velocity_mps, expected.velocity_mps, atol=1e-9)
            np.testing.assert_allclose(b.covariance, expected.covariance, atol=1e-9)


@pytest.mark.parametrize("frame_id", ["base_link", "odom"])
def test_a_person_who_stands_has_no_velocity_before_a_robot_that_drives_and_turns(
    frame_id: str,
) -> None:
    last = run(frame_id)[-1]
    stands, walks = (np.linalg.norm(track.velocity_mps) for track in last.tracks)
    assert stands < 1e-9
    assert walks == pytest.approx(0.5, abs=0.05)


def test_track_in_the_frame_of_a_turned_base() -> None:
    # The base is 1 m ahead and has turned to the left by 90 degrees: a person at (3, 0) who walks
    # along x is 2 m to its right, (0, -2), and walks along its -y. The variance along x becomes the
    # variance along y. A base with errors of 0.1 m and 0.05 rad adds 0.01 along both axes, and
    # (0.05 * 2)^2 = 0.01 at right angles to the line of sight, along x.
    track = builders.track(
        position_m=np.array([3.0, 0.0, 1.0]),
        velocity_mps=np.array([1.0, 0.0, 0.0]),
        covariance=np.diag([0.04, 0.01, 0.01, 0.2, 0.1, 0.1]),
        yaw_rad=0.5,
        hits=1,
        age=1,
        detection=None,
    )
    base = transform_from([1.0, 0.0, 0.0], rotation_from_rpy(0.0, 0.0, math.pi / 2))
    results = transform_track(track, TransformEstimate(invert(base), 0.1, 0.05))
    np.testing.assert_allclose(results.position_m, [0.0, -2.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(results.velocity_mps, [0.0, -1.0, 0.0], atol=1e-12)
    expected = [0.01 + 0.01 + 0.01, 0.04 + 0.01, 0.01, 0.1, 0.2, 0.1]
    np.testing.assert_allclose(np.diag(results.covariance), expected)
    assert results.yaw_rad == pytest.approx(0.5 - math.pi / 2)


def test_only_frames_on_a_base_move_with_it() -> None:
    frames = TransformBuffer()
    assert frames.fixed_frame("base_link") == "base_link"
    for message in (fixed("base_link", CAMERA, MOUNT), fixed("map", "odom", np.eye(4)), driven(0)):
        frames.add_transform(message)
    assert frames.fixed_frame("base_link") == frames.fixed_frame(CAMERA) == "odom"
    assert frames.fixed_frame("odom") == "odom"
    assert frames.fixed_frame("map") == "map"
