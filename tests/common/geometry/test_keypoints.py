"""Keypoints lifted to 3D by the depth that was read at them."""

import numpy as np
import pytest

from common.geometry.keypoints import lift
from people4d.messages import Detection
from tests import builders

INFO = builders.camera_info(width=160, height=120, fx=100.0)


def person(depth_m: float, confidence: float = 0.9) -> Detection:
    """Return a person two metres away, with the left shoulder at u 130, v 60."""
    keypoints, depths_m = np.zeros((17, 3), np.float32), np.zeros(17, np.float32)
    keypoints[5], depths_m[5] = (130, 60, confidence), depth_m
    position_m = np.array([0.0, 0.0, 2.0])
    return builders.detection(
        keypoints=keypoints, keypoint_depths_m=depths_m, position_m=position_m
    )


def test_keypoint_lies_at_the_depth_that_was_read() -> None:
    points_m = lift(person(2.1), INFO)
    assert points_m is not None
    assert points_m[5] == pytest.approx([1.05, 0.0, 2.1])  # (130 - 80) / 100 * 2.1 m
    assert np.isfinite(points_m).all(axis=1).sum() == 1


@pytest.mark.parametrize(
    "detection",
    [person(2.1, confidence=0.2), person(0.0), person(4.5)],  # uncertain, no depth, a wall
)
def test_keypoint_without_a_depth_of_its_own_is_unknown(detection: Detection) -> None:
    points_m = lift(detection, INFO)
    assert points_m is not None
    assert np.isnan(points_m).all()


def test_detection_without_depths_gives_no_points() -> None:
    assert lift(builders.detection(keypoints=np.zeros((17, 3), np.float32)), INFO) is None
