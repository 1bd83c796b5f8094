"""Likelihood of particles on an arm of a few vertices."""

import numpy as np
import pytest

from services.gait.config import DepthLayerConfig
from services.gait.points.body import Extremity, MeasuredBody
from services.gait.points.keypoints import Anchor
from services.gait.points.likelihood import (
    PointEvidence,
    agreement,
    combined_weights,
    single_feature_weights,
)
from services.gait.points.point_filter import PointFilter
from tests.gait.builders import INFO
from tests.gait.points.test_body import arm

COMBINED = DepthLayerConfig(particles=3)
GEODESIC = DepthLayerConfig(feature="geodesic", particles=3)
SPIN = DepthLayerConfig(feature="spin", particles=3)
MIDDLE = 19  # the vertex 9 cm before the fingertips, 51 cm along
HAND = Extremity(0, "hand", np.array([0.51, 0.0, 2.0]), 0.6, 1.0)


def hand_on(body: MeasuredBody, vertices: list[int], config: DepthLayerConfig) -> PointFilter:
    """A hand that started at its middle, with particles on these vertices; -1 is off the body."""
    point = PointFilter("left_hand", config, INFO, np.random.default_rng(0))
    point.start_at_vertex(MIDDLE, body, None)
    point.tip_distance_m = 0.09
    point.vertices = np.array(vertices)
    point.particles = np.zeros((len(vertices), 4))
    point.particles[:, :2] = body.mesh.pixels_px[point.vertices]
    return point


def test_agreement_is_gaussian() -> None:
    expected = [1.0, np.exp(-0.5), np.exp(-2.0)]
    assert agreement(np.array([0.0, -1.0, 2.0])) == pytest.approx(expected)


def test_single_feature_geodesic_weights_are_gaussian() -> None:
    # The hand's middle, 12 cm before it, off the body: 0, -(0.12 / 0.08)^2 / 2 = -1.125, never.
    body = arm()
    weights = single_feature_weights(hand_on(body, [MIDDLE, MIDDLE - 4, -1], GEODESIC), body, None)
    assert weights.logs == pytest.approx([0.0, -1.125, -np.inf])


def test_single_feature_spin_weights_are_similarities() -> None:
    body = arm()
    point = hand_on(body, [MIDDLE, MIDDLE - 4], SPIN)
    weights = single_feature_weights(point, body, np.array([3.0, 1.5]))
    assert weights.logs == pytest.approx([2.0, 1.0])


def test_combined_weights_are_largest_at_the_middle_of_the_hand() -> None:
    body = arm()
    point = hand_on(body, [MIDDLE - 4, MIDDLE, -1], COMBINED)
    weights = combined_weights(point, body, None, PointEvidence(extremity=HAND))
    assert int(np.argmax(weights.logs)) == 1
    assert weights.logs[2] == -np.inf
    assert weights.trust["geodesic"] == pytest.approx(1.0)


def test_geodesic_distance_without_agreement_is_not_trusted() -> None:
    # The hand touches the torso: all particles are 0.51 m nearer than they were.
    body = arm()
    weights = combined_weights(
        hand_on(body, [1, 1, 1], COMBINED), body, None, PointEvidence(extremity=HAND)
    )
    assert weights.trust["geodesic"] < 0.01


def test_confident_keypoint_overrules_the_body() -> None:
    # After 0.2 s of occlusion the hand may be anywhere near; the keypoint is at the elbow.
    body = arm()
    point = hand_on(body, [MIDDLE - 6, MIDDLE], COMBINED)
    assert point.motion is not None
    point.motion.predict(0.2)
    anchor = Anchor(point.particles[0, :2], 1.0, 0.9)
    weights = combined_weights(point, body, None, PointEvidence(anchor, 5.0, extremity=HAND))
    assert int(np.argmax(weights.logs)) == 0
