"""Selection of corners by contrast, depth and people."""

import numpy as np
import pytest

from services.visual_odometry.corners import CELL_PX, PeopleRegions, find_corners, read_depth_m


def test_each_cell_has_one_corner_in_order_of_contrast() -> None:
    """A bright and a dimmer square: the four corners of the bright square come first."""
    grey = np.zeros((120, 160), np.uint8)
    grey[30:50, 30:50] = 200
    grey[30:50, 110:130] = 60
    corners = find_corners(grey)
    cells = {tuple(cell) for cell in (corners // CELL_PX).astype(int).tolist()}
    assert len(cells) == len(corners)  # one each
    near = np.array([(x, y) for x in (30, 49) for y in (30, 49)])
    for corner in corners[:4]:
        assert np.abs(near - corner).max(axis=1).min() <= 3


@pytest.mark.parametrize("grey", [np.full((120, 160), 90, np.uint8), np.zeros((4, 4), np.uint8)])
def test_plain_image_has_no_corners(grey: np.ndarray) -> None:
    assert not len(find_corners(grey))


def test_an_edge_is_no_corner() -> None:
    grey = np.zeros((120, 160), np.uint8)
    grey[:, 75:] = 200
    assert not len(find_corners(grey))


def test_depth_is_the_median_of_the_surroundings() -> None:
    depth_mm = np.full((60, 60), 2000, np.uint16)
    depth_mm[20, 20] = 0  # 24 of 25 readings remain
    depth_mm[40:, :] = 4000  # an edge between rows 39 and 40
    depth_mm[:, 50:] = 0  # 10 of the 25 around column 50 remain: too few
    pixels = np.array([[20.0, 20.0], [20.0, 39.0], [50.0, 50.0], [55.0, 10.0], [0.0, 0.0]])
    depths, far = read_depth_m(depth_mm, pixels)
    assert depths == pytest.approx([2.0, np.nan, np.nan, np.nan, 2.0], nan_ok=True)
    assert far.tolist() == [False, False, False, True, False]


def test_depth_out_of_range_is_none() -> None:
    depth_mm = np.full((60, 60), 12_000, np.uint16)
    depth_mm[:, :30] = 200
    assert np.isnan(read_depth_m(depth_mm, np.array([[40.0, 30.0], [10.0, 30.0]]))[0]).all()


def test_people_cover_points_in_their_box_at_their_depth() -> None:
    """Box of 100 x 200 px with 15 % around it: 85 to 215 across; the person at 3 m, +- 0.7 m."""
    people = PeopleRegions(np.array([[100.0, 100.0, 200.0, 300.0]]), np.array([3.0]))
    pixels = np.array([[150, 200], [150, 200], [90, 200], [80, 200], [150, 340]], np.float64)
    depths = np.array([3.2, 4.0, 3.0, 3.0, 3.0])
    assert people.cover_points(pixels, depths).tolist() == [True, False, True, False, False]
    unknown = PeopleRegions(people.boxes_xyxy_px, np.array([np.nan]))
    assert unknown.cover_points(pixels, depths).tolist() == [True, True, True, False, False]
