"""What speaks for a particle, on an arm of a few vertices."""

import numpy as np
import pytest

from services.gait.points.config import DepthLayerConfig
from services.gait.points.limbs import Body3d, LimbEnd
from services.gait.points.point_filter import PointFilter
from services.gait.points.points import Anchor
from services.gait.points.weighing import Hints, agreement, alone, together
from tests.gait.bodies import INFO
from tests.gait.points.test_limbs import arm

COMBINED = DepthLayerConfig(particles=3, geodesic_sigma_m=0.1)
GEODESIC = DepthLayerConfig(feature="geodesic", particles=3, geodesic_sigma_m=0.1)
SPIN = DepthLayerConfig(feature="spin", particles=3, spin_sigma=2.0)
MIDDLE = 19  # the vertex 9 cm before the fingertips, 51 cm along
HAND = LimbEnd(0, "hand", np.array([0.51, 0.0, 2.0]), 0.6, 1.0)


def hand_on(body: Body3d, vertices: list[int], config: DepthLayerConfig) -> PointFilter:
    """A hand that started at its middle, with particles on these vertices; -1 is off the body."""
    point = PointFilter("left_hand", config, INFO, np.random.default_rng(0))
    point.start(MIDDLE, body, None)
    point.below_m = 0.09
    point.vertices = np.array(vertices)
    point.particles = np.zeros((len(vertices), 4))
    point.particles[:, :2] = body.surface.pixels_px[point.vertices]
    return point


def test_agreement_is_a_bell() -> None:
    expected = [1.0, np.exp(-0.5), np.exp(-2.0)]
    assert agreement(np.array([0.0, -1.0, 2.0])) == pytest.approx(expected)


def test_alone_distances_count_by_how_far_they_are_from_the_start() -> None:
    # The hand's middle, 12 cm before it, off the body: 0, -(0.12 / 0.1)^2 / 2 = -0.72, never.
    body = arm()
    told = alone(hand_on(body, [MIDDLE, MIDDLE - 4, -1], GEODESIC), body, None, Hints(), GEODESIC)
    assert told.logs == pytest.approx([0.0, -0.72, -np.inf])


def test_alone_spin_images_count_by_likeness() -> None:
    body = arm()
    point = hand_on(body, [MIDDLE, MIDDLE - 4], SPIN)
    told = alone(point, body, np.array([3.0, 1.0]), Hints(), SPIN)
    assert told.logs == pytest.approx([1.5, 0.5])


def test_together_the_middle_of_the_hand_weighs_most() -> None:
    body = arm()
    point = hand_on(body, [MIDDLE - 4, MIDDLE, -1], COMBINED)
    told = together(point, body, None, Hints(end=HAND), COMBINED)
    assert int(np.argmax(told.logs)) == 1
    assert told.logs[2] == -np.inf
    assert told.trust["geodesic"] == pytest.approx(1.0)


def test_a_distance_that_nothing_agrees_with_is_not_trusted() -> None:
    # The hand touches the trunk: all particles are 0.51 m nearer than they were.
    body = arm()
    told = together(hand_on(body, [1, 1, 1], COMBINED), body, None, Hints(end=HAND), COMBINED)
    assert told.trust["geodesic"] < 0.01


def test_a_sure_keypoint_overrules_the_body() -> None:
    # Not seen for a fifth of a second, the hand may be anywhere near; the keypoint is at the elbow.
    body = arm()
    point = hand_on(body, [MIDDLE - 6, MIDDLE], COMBINED)
    assert point.motion is not None
    point.motion.predict(0.2)
    anchor = Anchor(point.particles[0, :2], 1.0, 0.9)
    told = together(point, body, None, Hints(anchor, 5.0, end=HAND), COMBINED)
    assert int(np.argmax(told.logs)) == 0
