"""A silhouette divided by hand."""

import dataclasses

import numpy as np

from services.gait.surface.body import Mask
from services.gait.surface.body_config import BodyConfig
from services.gait.surface.parts import (
    HEAD,
    LEGS,
    SHOULDERS,
    TORSO,
    parts_of,
    rows_px_of,
    silhouette_widths,
)
from tests.gait.bodies import body_of


def silhouette() -> Mask:
    """120 rows: a round head of 12, a neck of 6, trunk and arms, and two legs."""
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
    parts = parts_of(body_of(silhouette() * 2.0), BodyConfig())
    assert parts is not None
    assert parts.neck_found
    assert (parts.top_row, parts.neck_row) == (2, 15)
    assert (parts.shoulders_row, parts.hips_row) == (22, 49)
    middle = parts.labels[:, 25]
    assert set(middle[2:15]) == {HEAD}
    assert set(middle[15:22]) == {SHOULDERS}
    assert set(middle[22:49]) == {TORSO}
    assert set(middle[49:62]) == {LEGS}
    assert np.array_equal(parts.labels > 0, silhouette())


def test_the_narrow_top_of_the_head_is_no_neck() -> None:
    # The first row is 4 wide, the neck 6.
    parts = parts_of(body_of(silhouette() * 2.0), BodyConfig())
    assert parts is not None
    assert parts.neck_row > 10


def test_a_body_without_a_neck_is_divided_as_most_are() -> None:
    # 0.13 of 100 rows.
    parts = parts_of(body_of(np.full((100, 20), 2.0)), BodyConfig())
    assert parts is not None
    assert not parts.neck_found
    assert parts.neck_row == 13


def test_rows_of_the_parts_count_in_the_whole_image() -> None:
    body = dataclasses.replace(body_of(silhouette() * 2.0), top_px=100)
    told = rows_px_of(body, BodyConfig())
    assert told == {"head": 102, "shoulders": 115, "torso": 122, "legs": 149}


def test_no_body_has_no_parts() -> None:
    assert rows_px_of(None, BodyConfig()) == {}
    assert parts_of(None, BodyConfig()) is None
    assert parts_of(body_of(np.zeros((5, 5))), BodyConfig()) is None


def test_bodies_of_few_rows_have_parts() -> None:
    for rows in range(1, 12):
        parts = parts_of(body_of(np.full((rows, 3), 2.0)), BodyConfig())
        assert parts is not None
        assert (parts.labels > 0).all()
