"""Acceptance of measured positions: hidden points, and points before their expected position."""

import numpy as np
import pytest

from services.gait.points.acceptance import Acceptance
from services.gait.points.body import MeasuredBody
from services.gait.points.keypoints import Anchor
from services.gait.points.limbs.surface import SurfacePosition
from services.gait.points.limbs.visibility import PointEvidence
from services.gait.points.normal import Normal
from services.gait.points.point_filter import PointFilter
from tests.gait.builders import INFO
from tests.gait.points.test_body import arm

HAND = 20  # index of a vertex 9 cm before the end of the arm


def hand_on(body: MeasuredBody) -> PointFilter:
    """A left hand that starts at its vertex."""
    point = PointFilter("left_hand")
    point.start_at_vertex(HAND, body)
    return point


@pytest.mark.parametrize(
    ("confidence", "state"), [(0.9, "measured"), (0.05, "predicted"), (None, "predicted")]
)
def test_hand_before_its_expected_position_is_hidden_unless_its_keypoint_is_there(
    confidence: float | None, state: str
) -> None:
    body = arm()
    point = hand_on(body)
    position_m = body.mesh.points_m[HAND]
    # The body expects the hand 30 cm behind the surface.
    point.prior = Normal(position_m + np.array([0.0, 0.0, 0.3]), 0.05**2 * np.eye(3))
    pixel = body.mesh.pixels_px[HAND].astype(float)
    anchor = None if confidence is None else Anchor(pixel, 1.0, confidence, pixel)
    surface = SurfacePosition(position_m, 0.03**2 * np.eye(3), HAND)
    acceptance = Acceptance(INFO)
    acceptance.has_keypoints = True
    acceptance.update_point(point, body, PointEvidence(anchor, surface=surface), 0.03)
    assert point.state == state


@pytest.mark.parametrize("trusts_keypoints", [False, True])
def test_with_keypoints_a_hand_is_measured_only_where_the_body_expects_hands(
    trusts_keypoints: bool,
) -> None:
    # Without a heading, or without a detection in this frame, there is no expectation.
    body = arm()
    point = hand_on(body)
    acceptance = Acceptance(INFO)
    acceptance.trusts_keypoints = trusts_keypoints
    surface = SurfacePosition(body.mesh.points_m[HAND], 1e-4 * np.eye(3), HAND, True)
    acceptance.update_point(point, body, PointEvidence(surface=surface), 0.03)
    assert point.state == ("predicted" if trusts_keypoints else "measured")


@pytest.mark.parametrize(("sigma_m", "state"), [(0.1, "predicted"), (0.3, "lost")])
def test_hand_that_could_be_anywhere_is_lost_until_it_is_less_uncertain(
    sigma_m: float, state: str
) -> None:
    point = hand_on(arm())
    assert point.motion is not None
    point.prior = Normal(point.motion.position_m, 9.0 * np.eye(3))
    point.motion.covariance[:3, :3] = sigma_m**2 * np.eye(3)
    point.mark_missed(0.03)
    assert point.estimate().state == state
    point.motion.covariance[:3, :3] = 0.05**2 * np.eye(3)
    assert point.estimate().state == "predicted"


@pytest.mark.parametrize(
    ("without_keypoints", "unsupported_s", "hidden"),
    [(True, 0.0, False), (True, 0.1, True), (False, 0.0, True)],
)
def test_hand_that_is_followed_may_be_before_the_torso(
    without_keypoints: bool, unsupported_s: float, hidden: bool
) -> None:
    body = arm()
    point = hand_on(body)
    position_m = body.mesh.points_m[HAND]
    point.prior = Normal(position_m + np.array([0.0, 0.0, 0.3]), 0.1**2 * np.eye(3))
    point.without_keypoints, point.unsupported_s = without_keypoints, unsupported_s
    assert Acceptance(INFO).is_hidden(point, position_m, None) == hidden


def test_expectation_of_a_hand_that_is_followed_is_where_it_moves() -> None:
    point = hand_on(arm())
    assert point.motion is not None
    point.motion.covariance[:3, :3] = 0.1**2 * np.eye(3)
    off_m = np.array([0.4, 0.0, 0.0])  # 2.8 standard deviations
    point.prior = Normal(point.motion.position_m + off_m, 0.1**2 * np.eye(3))
    between, point.without_keypoints = point.expected_position(), True
    followed = point.expected_position()
    assert between is not None
    assert followed is not None
    assert between.mean_m[0] - point.motion.position_m[0] == pytest.approx(0.2)
    assert followed.mean_m[0] - point.motion.position_m[0] < 0.03
