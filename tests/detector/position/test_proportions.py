import math

import numpy as np
import pytest

from people4d.messages import F64
from services.detector.position.proportions import UNKNOWN_M2, size_depth, torso_middles
from tests.detector.cameras import INFO

ALL = np.ones(4, np.bool_)
# Facing the camera, 1 m to the right and 0.5 m down: the left side is on the right.
FACING: F64 = np.array([[1.16, 0.25], [0.84, 0.25], [1.10, 0.75], [0.90, 0.75]])


def one(
    joints_m: F64, known: list[int], yaw_rad: float | None, sigma_m: float
) -> tuple[F64, float]:
    """Return the middle of one torso, and its variance."""
    chosen = np.isin(np.arange(4), known)
    points = np.where(chosen[:, None], joints_m, np.nan)[None]
    sigmas_m = np.array([sigma_m])
    middles_m, variances_m2 = torso_middles(points, chosen[None], [yaw_rad], sigmas_m)
    return middles_m[0], float(variances_m2[0])


def middle(known: list[int], yaw_rad: float | None, sigma_m: float = 0.001) -> F64:
    return one(FACING, known, yaw_rad, sigma_m)[0]


def test_the_middle_of_four_joints_is_their_mean() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        joints = rng.uniform(-1, 1, (4, 2))
        found, variance_m2 = one(joints, [0, 1, 2, 3], None, 0.04)
        np.testing.assert_allclose(found, joints.mean(axis=0), atol=1e-12)
        assert variance_m2 == pytest.approx(0.04**2 / 4)


@pytest.mark.parametrize("hidden", range(4))
def test_one_hidden_joint_is_estimated_from_the_others(hidden: int) -> None:
    known = [k for k in range(4) if k != hidden]
    np.testing.assert_allclose(middle(known, None), [1.0, 0.5], atol=0.002)


def test_shoulders_alone_are_above_the_middle_of_an_upright_body() -> None:
    # Their mean is (1.0, 0.25), the middle 0.25 m below.
    np.testing.assert_allclose(middle([0, 1], None), [1.0, 0.5], atol=0.002)


def test_one_side_gives_the_middle_if_the_yaw_is_known() -> None:
    # If the person faces the camera (yaw 180 deg), left shoulder and hip lie 0.13 m to the right on
    # average. If the yaw is unknown, their mean is used: (1.16 + 1.10) / 2 = 1.13.
    known = middle([0, 2], math.pi, sigma_m=0.03)
    np.testing.assert_allclose(known, [1.0, 0.5], atol=0.005)
    assert middle([0, 2], None)[0] > 1.05


def test_fewer_joints_have_more_variance() -> None:
    variances = [
        one(FACING, known, None, 0.04)[1] for known in ([0, 1, 2, 3], [0, 1, 2], [0, 2], [0])
    ]
    assert variances == sorted(variances)
    # One shoulder of unknown turn: 0.04^2 + 0.16^2 / 2 + (0.2 * 0.25)^2 = 0.0169.
    assert variances[-1] == pytest.approx(0.0169)
    assert one(FACING, [], None, 0.04)[1] == pytest.approx(UNKNOWN_M2)


def test_torsos_are_estimated_as_each_alone() -> None:
    joints_m = np.stack([FACING, FACING + 0.3, FACING * 2])
    known = np.array([[1, 1, 1, 1], [1, 0, 1, 0], [0, 0, 1, 1]], np.bool_)
    yaws_rad, sigmas_m = [math.pi, None, 0.5], np.array([0.03, 0.04, 0.05])
    middles_m, variances_m2 = torso_middles(joints_m, known, yaws_rad, sigmas_m)
    for k in range(3):
        alone_m, alone_m2 = one(
            joints_m[k], np.flatnonzero(known[k]).tolist(), yaws_rad[k], sigmas_m[k]
        )
        np.testing.assert_allclose(middles_m[k], alone_m)
        assert variances_m2[k] == pytest.approx(alone_m2)


def test_the_distance_at_which_a_torso_is_of_common_size() -> None:
    # fx = fy = 50: 0.5 m high in 10 px is 2.5 m away; shoulders of 0.32 m in 8 px: 2 m; the nearer
    # counts, since a body seen foreshortened looks smaller than it is.
    joints: F64 = np.array([[24.0, 10.0], [16.0, 10.0], [21.0, 20.0], [19.0, 20.0]])
    one_side, shoulders = np.array([True, False, True, False]), np.array([True, True, False, False])
    for known, depth_m, has_height in (
        (ALL, 2.0, True),
        (one_side, 25 / math.hypot(3, 10), True),
        (shoulders, 2.0, False),
    ):
        size = size_depth(joints.tolist(), known.tolist(), INFO)
        assert size is not None
        assert size.depth_m == pytest.approx(depth_m)
        assert size.has_height == has_height
    full = size_depth(joints.tolist(), ALL.tolist(), INFO)
    assert full is not None
    assert full.farthest_m == pytest.approx(5.0)  # hips: 0.2 m in 2 px
    assert size_depth(joints.tolist(), [True, False, False, False], INFO) is None
