"""Particles by one feature on an arm of a few vertices."""

import numpy as np
import pytest

from services.gait.config import DepthLayerConfig
from services.gait.points.body import MeasuredBody
from services.gait.points.single_feature import FeatureFilter, feature_weights
from tests.gait.points.test_body import arm

MIDDLE = 19  # the vertex 9 cm before the fingertips, 51 cm along


def hand_on(body: MeasuredBody, vertices: list[int]) -> FeatureFilter:
    """A hand that started at its middle, with particles on these vertices; -1 is off the body."""
    config = DepthLayerConfig(feature="geodesic", particles=3)
    point = FeatureFilter("left_hand", config, np.random.default_rng(0))
    point.start_at_vertex(MIDDLE, body)
    point.vertices = np.array(vertices)
    point.particles = np.zeros((len(vertices), 4))
    point.particles[:, :2] = body.mesh.pixels_px[point.vertices]
    return point


def test_geodesic_weights_are_gaussian() -> None:
    # The hand's middle, 12 cm before it, off the body: 0, -(0.12 / 0.08)^2 / 2 = -1.125, never.
    body = arm()
    weights = feature_weights(hand_on(body, [MIDDLE, MIDDLE - 4, -1]), body, None)
    assert weights == pytest.approx([0.0, -1.125, -np.inf])


def test_spin_weights_are_similarities() -> None:
    body = arm()
    weights = feature_weights(hand_on(body, [MIDDLE, MIDDLE - 4]), body, np.array([3.0, 1.5]))
    assert weights == pytest.approx([2.0, 1.0])


def test_heaviest_particle_is_the_estimate() -> None:
    body = arm()
    point = hand_on(body, [MIDDLE - 4, MIDDLE, -1])
    point.update_particles(body, None, 0.03)
    assert point.estimate().position_m == pytest.approx(body.mesh.points_m[MIDDLE])
    assert point.state == "measured"


def test_particles_off_the_body_return_to_the_last_position() -> None:
    body = arm()
    point = hand_on(body, [-1, -1, -1])
    point.update_particles(body, None, 0.03)
    assert point.state == "predicted"
    assert point.particles[:, :2] == pytest.approx(np.tile(body.mesh.pixels_px[MIDDLE], (3, 1)))
