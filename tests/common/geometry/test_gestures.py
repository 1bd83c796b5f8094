"""Gestures of arms."""

import numpy as np
import pytest

from common.geometry.gestures import hand_raised
from people4d.messages import F32
from services.skeleton.body import USUAL_POSE_M

ALL = [True] * 17
SMALL_M2: F32 = np.tile(1e-4 * np.eye(3, dtype=np.float32), (17, 1, 1))


def pose(wrist_z_m: float, elbow_z_m: float) -> F32:
    """Return the usual pose with the right wrist and elbow at other heights above the torso."""
    joints = USUAL_POSE_M.astype(np.float32)
    joints[[8, 10], 2] = elbow_z_m, wrist_z_m
    return joints


@pytest.mark.parametrize(
    ("wrist_z_m", "elbow_z_m", "expected"),
    [(0.7, 0.45, 1.0), (-0.23, -0.01, 0.0), (0.3, 0.1, 0.0), (0.7, -0.1, 0.0)],
)
def test_hand_is_raised_above_the_head_with_its_elbow(
    wrist_z_m: float, elbow_z_m: float, expected: float
) -> None:
    assert hand_raised(pose(wrist_z_m, elbow_z_m), SMALL_M2, ALL) == pytest.approx(
        expected, abs=1e-3
    )


def test_uncertain_wrist_gives_a_smaller_probability_and_hidden_wrist_none() -> None:
    raised = pose(0.7, 0.45)
    assert 0.5 < hand_raised(raised, 100 * 10 * SMALL_M2, ALL) < 0.9
    assert hand_raised(raised, SMALL_M2, [joint != 10 for joint in range(17)]) == 0.0
