"""Position covariance from the drift of odometry."""

import dataclasses
import math

import numpy as np

from common.geometry.planar_covariance import PlanarCovariance
from common.geometry.transforms import LINK_FROM_OPTICAL, rotation_from_rpy, transform_from
from people4d.messages import Tracks
from services.tracker.build import build
from services.tracker.config import TrackerConfig
from services.tracker.interface import Observation
from services.tracker.strongsort3d.base_drift import BaseDrift
from tests import builders
from tests.tracker.scene import frame


def at(x_m: float, yaw_rad: float) -> Observation:
    turn = rotation_from_rpy(0.0, 0.0, yaw_rad) @ LINK_FROM_OPTICAL[:3, :3]
    return dataclasses.replace(frame(0), map_from_camera=transform_from([x_m, 0.0, 1.0], turn))


def test_fixed_camera_adds_no_covariance() -> None:
    drift = BaseDrift()
    assert drift.since_last(at(0.0, 0.0), np.array([[4.0, 0.0, 1.0]])) is None
    assert drift.since_last(at(0.0, 0.0), np.array([[4.0, 0.0, 1.0]])) is None
    assert drift.since_last(frame(0), np.array([[4.0, 0.0, 1.0]])) is None


def test_turn_adds_covariance_sideways_and_distance_in_all_directions() -> None:
    # A turn of 0.25 rad: 0.05^2 * 0.25 = 0.000625, times 4^2 to the side of a person 4 m ahead:
    # 0.01. Then 1 m forward: 0.02^2 = 0.0004 in x and y.
    drift, position = BaseDrift(), np.array([[4.0, 0.0, 1.0]])
    drift.since_last(at(0.0, 0.0), position)
    turned = drift.since_last(at(0.0, 0.25), position)
    assert turned is not None
    np.testing.assert_allclose(turned[0], np.diag([0.0, 0.01, 0.0]), atol=1e-12)
    driven = drift.since_last(at(1.0, 0.25), position)
    assert driven is not None
    np.testing.assert_allclose(driven[0], np.diag([0.0004, 0.0004, 0.0]), atol=1e-12)


def test_covariance_of_a_turn_is_independent_of_the_frame_rate() -> None:
    position = np.array([[3.0, -1.0, 1.0]])
    drift, parts = BaseDrift(), BaseDrift()
    drift.since_last(at(0.0, 0.0), position)
    at_once = drift.since_last(at(0.0, math.pi / 4), position)
    in_steps = np.zeros((1, 3, 3))
    for k in range(11):
        step = parts.since_last(at(0.0, k * math.pi / 40), position)
        in_steps += 0.0 if step is None else step
    assert at_once is not None
    np.testing.assert_allclose(in_steps, at_once)


def test_covariance_of_the_odometry_replaces_the_random_walk() -> None:
    # The motion adds 0.02 along x, 0.03 along y and 0.001 of angle. A person 4 m ahead of the base:
    # 0.03 + 4^2 * 0.001 = 0.046 sideways.
    drift, position = BaseDrift(), np.array([[4.0, 0.0, 1.0]])
    first = PlanarCovariance(np.diag([0.1, 0.1, 1e-9]), np.zeros(2))
    second = PlanarCovariance(np.diag([0.12, 0.13, 0.001 + 1e-9]), np.zeros(2))
    drift.since_last(dataclasses.replace(at(0.0, 0.0), base=first), position)
    turned = drift.since_last(dataclasses.replace(at(0.0, 0.25), base=second), position)
    assert turned is not None
    np.testing.assert_allclose(turned[0], np.diag([0.02, 0.046, 0.0]), atol=1e-9)
    # A constant covariance is ignored: 0.02^2 for a metre.
    driven = drift.since_last(dataclasses.replace(at(1.0, 0.25), base=second), position)
    assert driven is not None
    np.testing.assert_allclose(driven[0], np.diag([0.0004, 0.0004, 0.0]), atol=1e-9)


def test_odometry_with_covariance_widens_tracks_in_the_node() -> None:
    # A large covariance of the yaw of the base gives a large covariance of its tracks.
    assert track_variance_m2(1e-6) < track_variance_m2(None) < track_variance_m2(0.05)


def track_variance_m2(rate: float | None) -> float:
    """Return the sideways variance of a track after a turn, given the rate of yaw variance."""
    node = build(TrackerConfig(frame_id="odom", embedding_wait_s=0.0))
    node.handle(builders.static_transform(LINK_FROM_OPTICAL, parent="base_link", child="camera"), 0)
    variance_m2 = 0.0
    for k in range(6):
        stamp_ns = k * 100_000_000
        covariance = None if rate is None else np.diag([1e-6, 1e-6, rate]) * (k + 1)
        base = builders.odometry(
            stamp_ns=stamp_ns,
            frame_id="odom",
            child_frame_id="base_link",
            theta_rad=0.1 * k,
            covariance=covariance,
        )
        node.handle(base, 0)
        yaw_rad = -0.1 * k
        position_m = np.array([-3.0 * math.sin(yaw_rad), 0.0, 3.0 * math.cos(yaw_rad)])
        people = [builders.detection(position_m=position_m)] if k < 5 else []
        shown = builders.detections(*people, stamp_ns=stamp_ns, sequence=k, frame_id="camera")
        for message in node.handle(shown, 0):
            if isinstance(message, Tracks) and message.tracks:
                variance_m2 = float(message.tracks[0].covariance[1, 1])
    return variance_m2
