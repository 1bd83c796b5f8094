"""Boxes in the image."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.geometry.boxes import iou_xyxy, nms


def test_iou_by_hand() -> None:
    # Two 2x2 boxes that share 1x1: 1 / (4 + 4 - 1). Half of a 2x2 box: 2 / (4 + 2 - 2).
    a = [[0, 0, 2, 2]]
    b = [[1, 1, 3, 3], [0, 0, 2, 1], [0, 0, 2, 2], [2, 0, 4, 2], [5, 5, 6, 6]]
    np.testing.assert_allclose(iou_xyxy(a, b), [[1 / 7, 1 / 2, 1.0, 0.0, 0.0]])


def test_iou_of_empty_and_inverted_boxes_is_zero() -> None:
    point, inverted, box = [1, 1, 1, 1], [3, 3, 0, 0], [0, 0, 3, 3]
    np.testing.assert_array_equal(iou_xyxy([point, inverted], [point, inverted, box]), 0.0)
    assert iou_xyxy([], [box]).shape == (0, 1)
    assert iou_xyxy([box], np.zeros((0, 4))).shape == (1, 0)


BOXES = st.lists(
    st.tuples(st.integers(0, 9), st.integers(0, 9), st.integers(1, 9), st.integers(1, 9)).map(
        lambda b: (b[0], b[1], b[0] + b[2], b[1] + b[3])
    ),
    min_size=1,
    max_size=6,
)


@pytest.mark.slow
@settings(deadline=None)
@given(BOXES, BOXES, st.integers(-50, 50))
def test_iou_is_symmetric_bounded_and_does_not_care_where(
    a: list[tuple[int, ...]], b: list[tuple[int, ...]], shift: int
) -> None:
    iou = iou_xyxy(a, b)
    np.testing.assert_array_equal(iou, iou_xyxy(b, a).T)
    np.testing.assert_allclose(iou, iou_xyxy(np.array(a) + shift, np.array(b) + shift))
    assert iou.min() >= 0
    assert iou.max() <= 1
    np.testing.assert_array_equal(np.diag(iou_xyxy(a, a)), 1.0)


def test_nms_by_hand() -> None:
    # Box 1 is the best; box 0 overlaps it by 9/11 = 0.82; box 2 overlaps it by 1/7; box 3 by none.
    boxes = [
        [0.0, 0.0, 10.0, 9.0],
        [0.0, 0.0, 10.0, 11.0],
        [5.0, 5.5, 15.0, 16.5],
        [50.0, 50.0, 60.0, 60.0],
    ]
    scores = [0.8, 0.9, 0.3, 0.5]
    # Overlap of 1 and 2: 5 x 5.5 = 27.5 of 110 + 110 - 27.5 = 192.5, 1/7.
    assert nms(boxes, scores, 0.5) == [1, 3, 2]
    assert nms(boxes, scores, 0.1) == [1, 3]
    assert nms(boxes, scores, 0.9) == [1, 0, 3, 2]
    assert nms([], [], 0.5) == []


def test_nms_keeps_what_only_overlaps_a_suppressed_box() -> None:
    # A chain: 0 suppresses 1, and 2, which only overlaps 1, stays. Neighbours share 6 of 14.
    assert nms([[0, 0, 10, 1], [4, 0, 14, 1], [8, 0, 18, 1]], [0.9, 0.8, 0.7], 0.3) == [0, 2]


def test_nms_of_equal_scores_keeps_the_first() -> None:
    assert nms([[0, 0, 4, 4], [0, 0, 4, 4]], [0.5, 0.5], 0.5) == [0]
