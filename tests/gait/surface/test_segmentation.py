"""Holes and components by hand, and boxes without a person."""

import numpy as np
import pytest

from people4d.messages import U16
from services.gait.surface import segmentation
from services.gait.surface.segmentation import components, fill_holes, segment_body

BOX = np.array([0.0, 0.0, 40.0, 60.0])


def wall(depth_mm: int = 4000) -> U16:
    return np.full((60, 40), depth_mm, np.uint16)


def room() -> U16:
    """A person of 10 x 40 pixels at 2 m before a wall at 4 m."""
    depth = wall()
    depth[10:50, 15:25] = 2000
    return depth


def test_hole_is_filled_with_the_lower_median() -> None:
    # Eight neighbours: 2.0 three times, 2.2, 2.3 and 3.0 three times. The fourth of the eight is
    # 2.2: the lower of the two in the middle, so that nothing is put between person and wall.
    depth = np.array([[2.0, 2.2, 3.0], [2.0, 0.0, 3.0], [2.0, 2.3, 3.0]], np.float32)
    filled = fill_holes(depth)
    assert filled[1, 1] == np.float32(2.2)
    filled[1, 1] = 0
    assert np.array_equal(filled, depth)


def test_a_hole_at_the_border_has_fewer_neighbours() -> None:
    # Of the corner's three neighbours one is a hole: 2.0 and 2.4 are left, the lower counts.
    depth = np.array([[0.0, 2.4], [2.0, 0.0]], np.float32)
    assert fill_holes(depth)[0, 0] == np.float32(2.0)
    assert fill_holes(depth, neighbours_min=3)[0, 0] == 0


def test_wide_hole_is_filled_from_its_rim() -> None:
    # 3 x 3: the middle has no neighbour with depth at first.
    depth = np.full((5, 5), 2, np.float32)
    depth[1:4, 1:4] = 0
    once = fill_holes(depth)
    assert once[2, 2] == 0
    assert np.count_nonzero(once == 0) == 1
    assert (fill_holes(once) == 2).all()


@pytest.mark.usefixtures("published")
def test_components_by_hand() -> None:
    # Neighbours differ by 5 mm (one part), 25 mm (two parts) or lie at a corner (two parts).
    depth = np.array([[2.000, 2.005, 2.030], [0.0, 0.0, 2.035], [2.030, 0.0, 0.0]], np.float32)
    labels, sizes = components(depth)
    assert labels.tolist() == [[1, 1, 2], [0, 0, 2], [3, 0, 0]]
    assert sizes.tolist() == [4, 2, 2, 1]


@pytest.mark.usefixtures("published")
def test_u_shape_is_one_component() -> None:
    # The arms of a U are labelled apart until the row in which they meet.
    depth = np.array([[2, 0, 2, 0, 0, 2], [2, 0, 2, 0, 0, 0], [2, 2, 2, 0, 2, 2]], np.float32)
    labels, sizes = components(depth)
    assert labels.tolist() == [[1, 0, 1, 0, 0, 2], [1, 0, 1, 0, 0, 0], [1, 1, 1, 0, 3, 3]]
    assert sizes.tolist() == [8, 7, 1, 2]


@pytest.mark.usefixtures("published")
def test_a_slope_is_one_component() -> None:
    # 9 mm from pixel to pixel, 0.9 m in all.
    depth = (2 + 0.009 * np.arange(101, dtype=np.float32))[None]
    assert components(depth)[0].max() == 1


def test_continuity_grows_with_the_distance() -> None:
    # 6 mm by metre and three times 2.5 mm by square metre: 13.5 mm at 1 m, 144 mm at 4 m.
    for near, far, parts in [(1.0, 1.012, 1), (1.0, 1.015, 2), (4.0, 4.12, 1), (4.0, 4.16, 2)]:
        assert components(np.array([[near, far]], np.float32))[0].max() == parts


def test_largest_component_is_the_body_without_seed() -> None:
    body = segment_body(room(), BOX, None)
    assert body is not None
    assert body.mask.sum() == 60 * 40 - 40 * 10
    assert body.depth_m[30, 20] == 0


def test_seed_depth_selects_the_component() -> None:
    body = segment_body(room(), BOX, 2.1)
    assert body is not None
    assert body.mask.sum() == 40 * 10
    assert body.mask[10:50, 15:25].all()
    assert np.unique(body.depth_m).tolist() == [0, 2]


def test_seed_without_component_leaves_the_largest_within_reach() -> None:
    body = segment_body(room(), BOX, 2.8)
    assert body is not None
    assert body.mask.sum() == 40 * 10  # the wall is 1.2 m behind, farther than any arm
    assert segment_body(room(), BOX, 9.0) is None


def test_a_box_may_reach_out_of_the_image() -> None:
    body = segment_body(room(), np.array([-20.0, 5.0, 22.5, 900.0]), 2.0)
    assert body is not None
    assert (body.left_px, body.top_px, body.mask.shape) == (0, 5, (55, 23))
    assert body.mask.sum() == 40 * 8


def test_a_hole_in_the_body_is_filled() -> None:
    depth = room()
    depth[20:22, 18:20] = 0
    body = segment_body(depth, BOX, 2.0)
    assert body is not None
    assert body.mask[20:22, 18:20].all()


def legs(beside: int = 25) -> U16:
    """A person with the far leg visible next to the near one, 0.25 m behind it."""
    depth = room()
    depth[35:50, beside : beside + 4] = 2250
    return depth


def test_part_occluded_at_its_joint_is_joined() -> None:
    body = segment_body(legs(), BOX, 2.0)
    assert body is not None
    assert body.mask.sum() == 40 * 10 + 15 * 4


def carrier() -> U16:
    """A person with a box 0.3 m before the torso and 0.35 m before the legs, which are larger."""
    depth = wall()
    depth[10:20, 15:25] = 2000
    depth[20:28, 13:27] = 1700
    depth[28:55, 15:25] = 2050
    return depth


@pytest.mark.parametrize("seed_m", [1.7, 2.0])
def test_legs_below_a_carried_box_are_joined(seed_m: float) -> None:
    body = segment_body(carrier(), BOX, seed_m)
    assert body is not None
    assert body.mask.sum() == 10 * 10 + 8 * 14 + 27 * 10


def test_large_part_over_the_same_rows_is_another_person() -> None:
    depth = room()
    depth[12:48, 25:33] = 2250
    body = segment_body(depth, BOX, 2.0)
    assert body is not None
    assert body.mask.sum() == 40 * 10


def test_large_part_far_behind_is_another_person() -> None:
    # By a part 0.35 m behind both it would be adjacent, 0.7 m behind the body.
    depth = wall()
    depth[10:30, 15:25] = 2000
    depth[30:34, 15:25] = 2350
    depth[34:55, 15:25] = 2700
    body = segment_body(depth, BOX, 2.0)
    assert body is not None
    assert body.mask.sum() == 20 * 10 + 4 * 10


@pytest.mark.parametrize(
    "depth",
    [
        pytest.param(legs(beside=36), id="reaches the side of the box"),
        pytest.param(legs(beside=31), id="too far beside"),
        pytest.param(np.where(legs() == 2250, 2500, legs()).astype(np.uint16), id="too far behind"),
    ],
)
def test_other_nearby_component_is_not_joined(depth: U16) -> None:
    body = segment_body(depth, BOX, 2.0)
    assert body is not None
    assert body.mask.sum() == 40 * 10


@pytest.mark.parametrize(
    "box",
    [
        (10.0, 10.0, 10.0, 40.0),
        (30.0, 10.0, 20.0, 40.0),
        (-50.0, -50.0, -1.0, -1.0),
        (500.0, 0.0, 600.0, 60.0),
        (np.nan, 0.0, 40.0, 60.0),
        (0.0, 0.0, np.inf, 60.0),
        (-1e300, -1e300, -1e299, 1e300),
        (),
    ],
)
def test_invalid_or_empty_box_has_no_body(box: tuple[float, ...]) -> None:
    assert segment_body(room(), np.array(box), 2.0) is None


@pytest.mark.parametrize("seed", [None, 2.0, np.nan, -1.0, np.inf])
def test_no_depth_gives_no_body(seed: float | None) -> None:
    assert segment_body(wall(0), BOX, seed) is None


def test_body_has_30_pixels_or_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(segmentation, "FILL_PASSES", 0)
    depth = wall(0)
    depth[10:39, 20] = 2000
    assert segment_body(depth, BOX, 2.0) is None
    depth[39, 20] = 2000
    body = segment_body(depth, BOX, 2.0)
    assert body is not None
    assert body.mask.sum() == 30


@pytest.mark.usefixtures("published")
def test_mask_equals_depth_and_lies_in_the_image() -> None:
    random = np.random.default_rng(0)
    for seed in [None, 1.0, 3.0] * 10:
        depth = (random.random((60, 40)) * 4000).astype(np.uint16)
        depth[random.random(depth.shape) < 0.3] = 0
        box = random.uniform(-20, 80, 4)
        body = segment_body(depth, box, seed)
        if body is not None:
            assert np.array_equal(body.depth_m > 0, body.mask)
            height, width = body.mask.shape
            assert body.left_px >= 0
            assert body.top_px >= 0
            assert body.left_px + width <= 40
            assert body.top_px + height <= 60
