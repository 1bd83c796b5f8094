"""Tracks on a robot whose odometry drifts, by hand."""

import math

import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL, rotation_from_rpy, transform_from
from evaluation.run.run import OdometryDrift
from people4d.messages import F64, Odometry, StaticTransform, Track
from tests import builders

CAMERA = "front_optical_frame"


def base(x_m: float, y_m: float, yaw_rad: float) -> F64:
    return transform_from([x_m, y_m, 0.0], rotation_from_rpy(0.0, 0.0, yaw_rad))


def fixed(parent: str, child: str, matrix: F64) -> StaticTransform:
    return builders.static_transform(matrix, parent=parent, child=child)


def odometry(stamp_ns: int, x_m: float, theta_rad: float) -> Odometry:
    return builders.odometry(stamp_ns=stamp_ns, frame_id="map", x_m=x_m, theta_rad=theta_rad)


def one(x_m: float, y_m: float, yaw_rad: float) -> Track:
    return builders.track(
        hits=1,
        age=1,
        position_m=np.array([x_m, y_m, 1.0]),
        velocity_mps=np.array([0.5, 0.0, 0.0]),
        yaw_rad=yaw_rad,
    )


def test_drift_of_position_and_yaw_is_removed() -> None:
    # Odometry puts the robot at (1, 0), facing x; in truth it is at (2, 1), facing y. A person
    # tracked at (4, 0) is 3 m ahead of it, so in truth at (2, 4). Motion along x is in truth along
    # y.
    drift = OdometryDrift(
        [fixed("base_link", CAMERA, LINK_FROM_OPTICAL), odometry(0, 1.0, 0.0)], "map", CAMERA
    )
    camera = base(2.0, 1.0, math.pi / 2) @ LINK_FROM_OPTICAL
    track = drift.correct(one(4.0, 0.0, math.pi * 0.75), 0, camera)
    np.testing.assert_allclose(track.position_m, [2.0, 4.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(track.velocity_mps, [0.0, 0.5, 0.0], atol=1e-12)
    assert track.yaw_rad == pytest.approx(-math.pi * 0.75)


def test_a_camera_that_stands_does_not_drift() -> None:
    drift = OdometryDrift([fixed("map", CAMERA, LINK_FROM_OPTICAL)], "map", CAMERA)
    track = one(1.0, 2.0, 0.0)
    assert drift.correct(track, 0, base(9.0, 0.0, 0.0) @ LINK_FROM_OPTICAL) is track


def test_where_the_robot_is_must_be_known() -> None:
    drift = OdometryDrift(
        [fixed("base_link", CAMERA, LINK_FROM_OPTICAL), odometry(10, 1, 0)], "map", CAMERA
    )
    track = one(1.0, 2.0, 0.0)
    assert drift.correct(track, 10, None) is track
    assert drift.correct(track, 9, LINK_FROM_OPTICAL) is track  # before the first odometry
