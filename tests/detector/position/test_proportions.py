import math

import numpy as np
import pytest

from people4d.messages import F64
from services.detector.position.proportions import size_depth
from tests.detector.cameras import INFO

ALL = np.ones(4, np.bool_)


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
