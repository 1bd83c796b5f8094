"""Odometry drifts: what a base adds to the doubt about where people are."""

import dataclasses
import math

import numpy as np

from common.geometry.transform_history import TransformBufferConfig
from common.geometry.transforms import LINK_FROM_OPTICAL, rotation_from_rpy, transform_from
from services.tracker.interface import Observation
from services.tracker.strongsort3d.base_drift import BaseDrift
from tests.tracker.scene import frame

CONFIG = TransformBufferConfig(drift_distance_m=0.1, drift_rotation_rad=0.05)


def at(x_m: float, yaw_rad: float) -> Observation:
    turn = rotation_from_rpy(0.0, 0.0, yaw_rad) @ LINK_FROM_OPTICAL[:3, :3]
    return dataclasses.replace(frame(0), map_from_camera=transform_from([x_m, 0.0, 1.0], turn))


def test_fixed_camera_adds_no_covariance() -> None:
    drift = BaseDrift(CONFIG)
    assert drift.since_last(at(0.0, 0.0), np.array([[4.0, 0.0, 1.0]])) is None
    assert drift.since_last(at(0.0, 0.0), np.array([[4.0, 0.0, 1.0]])) is None
    assert drift.since_last(frame(0), np.array([[4.0, 0.0, 1.0]])) is None


def test_turn_adds_covariance_sideways_and_distance_in_all_directions() -> None:
    # A quarter of a radian: 0.05^2 * 0.25 = 0.000625, times 4^2 to the side of a person 4 m
    # ahead: 0.01. After that 1 m forward: 0.1^2 = 0.01 each way on the ground.
    drift, position = BaseDrift(CONFIG), np.array([[4.0, 0.0, 1.0]])
    drift.since_last(at(0.0, 0.0), position)
    turned = drift.since_last(at(0.0, 0.25), position)
    assert turned is not None
    np.testing.assert_allclose(turned[0], np.diag([0.0, 0.01, 0.0]), atol=1e-12)
    driven = drift.since_last(at(1.0, 0.25), position)
    assert driven is not None
    np.testing.assert_allclose(driven[0], np.diag([0.01, 0.01, 0.0]), atol=1e-12)


def test_covariance_of_a_turn_is_independent_of_the_frame_rate() -> None:
    position = np.array([[3.0, -1.0, 1.0]])
    drift, parts = BaseDrift(CONFIG), BaseDrift(CONFIG)
    drift.since_last(at(0.0, 0.0), position)
    at_once = drift.since_last(at(0.0, math.pi / 4), position)
    in_steps = np.zeros((1, 3, 3))
    for k in range(11):
        step = parts.since_last(at(0.0, k * math.pi / 40), position)
        in_steps += 0.0 if step is None else step
    assert at_once is not None
    np.testing.assert_allclose(in_steps, at_once)
