"""Intervals, boxes and overlaps of people in the image."""

import numpy as np

from common.geometry.transforms import LINK_FROM_OPTICAL, invert
from services.tracker.strongsort3d.policies import cut_off
from services.tracker.strongsort3d.visibility import common_ratios, intervals, overlap_ratios

OPTICAL_FROM_LINK = invert(LINK_FROM_OPTICAL)


def test_overlap_of_two_intervals() -> None:
    # At 2 m, half a width of 0.25 m covers -0.125 to 0.125; at 4 m and 0.5 m to the left -0.1875 to
    # -0.0625. They share 0.0625: a quarter of the first, half of the second.
    people, depth_m = intervals(np.array([[2, 0, 1], [4, 0.5, 1.0]]), OPTICAL_FROM_LINK)
    np.testing.assert_allclose(people, [[-0.125, 0.125], [-0.1875, -0.0625]])
    np.testing.assert_allclose(depth_m, [2, 4])
    np.testing.assert_allclose(overlap_ratios(people, people), [[1, 0.25], [0.5, 1]])


def test_common_parts_of_boxes_and_cut_off_ones() -> None:
    # 10x10 and 5x10 share 3x10: 0.3 of the first and 0.6 of the second; the third is alone.
    boxes = np.array([[0, 0, 10, 10], [7, 0, 12, 10], [50, 0, 60, 10.0]])
    shares = [[0.0, 0.3, 0.0], [0.6, 0.0, 0.0], [0.0, 0.0, 0.0]]
    np.testing.assert_allclose(common_ratios(boxes), shares)
    # 1 % of 100 px: a box nearer to the side of the image than 1 px may be cut off.
    assert cut_off(boxes, None).tolist() == [False, False, False]
    assert cut_off(boxes, (100, 10)).tolist() == [True, False, False]
