"""Parts of a silhouette by hand."""

import dataclasses

import numpy as np

from services.gait.surface.segmentation import Mask
from services.gait.surface.silhouette import neck_row, part_rows_px, silhouette_widths
from tests.gait.builders import body_of


def silhouette() -> Mask:
    """120 rows: a round head of 12, a neck of 6, torso and arms, and two legs."""
    mask = np.zeros((124, 50), np.bool_)
    rows = mask[2:]  # two empty rows above
    for row, half in enumerate([2, 4, 5, 6, 7, 7, 7, 7, 7, 6, 6, 5]):
        rows[row, 25 - half : 25 + half] = True
    rows[12:18, 22:28] = True
    rows[18:60, 8:42] = True
    rows[60:120, 12:22] = True
    rows[60:120, 28:38] = True
    return mask


def test_widths_are_counted_from_the_first_to_the_last_pixel() -> None:
    mask = np.array([[0, 0, 0, 0], [0, 1, 0, 1], [1, 0, 0, 0]], np.bool_)
    assert silhouette_widths(mask).tolist() == [0, 3, 1]


def test_parts_by_hand() -> None:
    # The head begins in row 2. Its neck is 6 wide in the rows 14 to 19; the mean of three rows is
    # least in 15, the first with 6 above and below: the head is 13 rows. The torso begins 1.5 of
    # these below the top, 2 + 19.5 (rounded to the even 22), the legs 3.6, at 2 + 46.8 = 49.
    rows = part_rows_px(body_of(silhouette() * 2.0))
    assert rows == {"head": 2, "shoulders": 15, "torso": 22, "legs": 49}


def test_narrow_top_of_the_head_is_no_neck() -> None:
    # The first row is 4 wide, the neck 6.
    row = neck_row(silhouette_widths(silhouette()[2:]))
    assert row is not None
    assert row > 8


def test_body_without_neck_is_divided_by_mean_proportions() -> None:
    # 0.13 of 100 rows.
    rows = part_rows_px(body_of(np.full((100, 20), 2.0)))
    assert neck_row(np.full(100, 20.0)) is None
    assert rows["shoulders"] == 13


def test_rows_of_parts_are_in_the_image() -> None:
    body = dataclasses.replace(body_of(silhouette() * 2.0), top_px=100)
    rows = part_rows_px(body)
    assert rows == {"head": 102, "shoulders": 115, "torso": 122, "legs": 149}


def test_no_body_gives_no_parts() -> None:
    assert part_rows_px(None) == {}
    assert part_rows_px(body_of(np.zeros((5, 5)))) == {}


def test_bodies_of_few_rows_have_parts() -> None:
    for height in range(1, 12):
        rows = list(part_rows_px(body_of(np.full((height, 3), 2.0))).values())
        assert rows == sorted(rows)
        assert rows[-1] <= height
