"""Covariances of odometry, worked by hand: added motion, and invalid covariances."""

import math

import numpy as np
import pytest

from common.geometry.planar_covariance import PlanarCovariance, is_plausible
from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transforms import rotation_from_rpy, transform_from
from people4d.messages import F64, Odometry
from tests import builders

SMALL = np.diag([0.01, 0.02, 0.001])


def at(x_m: float, y_m: float, covariance: F64) -> PlanarCovariance:
    return PlanarCovariance(covariance, np.array([x_m, y_m]))


def test_motion_adds_what_the_former_error_of_the_angle_does_not_explain() -> None:
    # 2 m ahead with an error of the angle of variance 0.001: 4 * 0.001 sideways, 2 * 0.001 in
    # common with the angle. The motion itself adds 0.03, 0.04 and 0.005.
    J = np.array([[1.0, 0, 0], [0, 1, 2], [0, 0, 1]])
    own = np.diag([0.03, 0.04, 0.005])
    after = J @ SMALL @ J.T + own
    assert after[1, 1] == pytest.approx(0.02 + 0.004 + 0.04)
    growth = at(3.0, 1.0, after).growth(at(1.0, 1.0, SMALL))
    assert growth is not None
    np.testing.assert_allclose(growth, own, atol=1e-12)


def test_covariance_that_stays_or_shrinks() -> None:
    assert at(1.0, 0.0, SMALL).growth(at(0.0, 0.0, SMALL)) is None  # a constant of the driver
    shrunk = at(0.0, 0.0, 0.5 * SMALL).growth(at(0.0, 0.0, SMALL))  # a filter found itself
    assert shrunk is not None
    np.testing.assert_allclose(shrunk, np.zeros((3, 3)), atol=1e-12)


@pytest.mark.parametrize(
    "absurd",
    [
        np.zeros((3, 3)),
        np.diag([-1.0, -1.0, -1.0]),
        np.diag([1e6, 1e6, 1e6]),
        np.diag([0.1, 0.1, 20.0]),
        np.array([[1.0, 2, 0], [2, 1, 0], [0, 0, 1]]),
        np.array([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]]),
    ],
)
def test_absurd_covariance_is_refused_and_counted(absurd: F64) -> None:
    assert not is_plausible(absurd, 100.0, 3.2)
    buffer = TransformBuffer()
    buffer.add_transform(odometry(0, 0.0, absurd))
    estimate = buffer.lookup("odom", "base_link", 0)
    assert estimate is not None
    assert estimate.base is None
    assert buffer.counters["motion_bad_covariances"] == 1


def test_covariance_is_interpolated_and_turned_into_the_frame_that_is_asked_for() -> None:
    buffer = TransformBuffer()
    turn = transform_from((5.0, 0.0, 0.0), rotation_from_rpy(0.0, 0.0, math.pi / 2))
    buffer.add_transform(builders.static_transform(turn, parent="map", child="odom"))
    buffer.add_transform(odometry(0, 1.0, SMALL))
    buffer.add_transform(odometry(100_000_000, 1.2, 3 * SMALL))
    estimate = buffer.lookup("map", "base_link", 50_000_000)
    assert estimate is not None
    assert estimate.base is not None
    np.testing.assert_allclose(estimate.base.matrix, np.diag([0.04, 0.02, 0.002]), atol=1e-12)
    np.testing.assert_allclose(estimate.base.position_m, [5.0, 1.1], atol=1e-12)


def odometry(stamp_ns: int, x_m: float, covariance: F64) -> Odometry:
    return builders.odometry(
        stamp_ns=stamp_ns,
        frame_id="odom",
        child_frame_id="base_link",
        x_m=x_m,
        covariance=covariance,
    )
