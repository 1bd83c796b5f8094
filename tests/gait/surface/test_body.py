"""Holes and components by hand, and boxes that hold nobody."""

import msgspec
import numpy as np
import pytest

from people4d.messages import U16
from services.gait.surface.body import components, fill_holes, find_body
from services.gait.surface.body_config import BodyConfig
from tests.gait.bodies import PAPER

BOX = np.array([0.0, 0.0, 40.0, 60.0])


def wall(depth_mm: int = 4000) -> U16:
    return np.full((60, 40), depth_mm, np.uint16)


def room() -> U16:
    """A person of 10 x 40 pixels at 2 m before a wall at 4 m."""
    depth = wall()
    depth[10:50, 15:25] = 2000
    return depth


def test_a_hole_by_hand() -> None:
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


def test_a_wide_hole_is_filled_from_its_rim() -> None:
    # 3 x 3: the middle has no neighbour with depth at first.
    depth = np.full((5, 5), 2, np.float32)
    depth[1:4, 1:4] = 0
    once = fill_holes(depth)
    assert once[2, 2] == 0
    assert np.count_nonzero(once == 0) == 1
    assert (fill_holes(once) == 2).all()


def test_components_by_hand() -> None:
    # Neighbours differ by 5 mm (one part), 25 mm (two parts) or lie at a corner (two parts).
    depth = np.array([[2.000, 2.005, 2.030], [0.0, 0.0, 2.035], [2.030, 0.0, 0.0]], np.float32)
    labels, sizes = components(depth, PAPER)
    assert labels.tolist() == [[1, 1, 2], [0, 0, 2], [3, 0, 0]]
    assert sizes.tolist() == [4, 2, 2, 1]


def test_arms_that_meet_further_down_are_one_component() -> None:
    # The arms of a U are labelled apart until the row in which they meet.
    depth = np.array([[2, 0, 2, 0, 0, 2], [2, 0, 2, 0, 0, 0], [2, 2, 2, 0, 2, 2]], np.float32)
    labels, sizes = components(depth, PAPER)
    assert labels.tolist() == [[1, 0, 1, 0, 0, 2], [1, 0, 1, 0, 0, 0], [1, 1, 1, 0, 3, 3]]
    assert sizes.tolist() == [8, 7, 1, 2]


def test_a_slope_is_one_component() -> None:
    # 9 mm from pixel to pixel, 0.9 m in all.
    depth = (2 + 0.009 * np.arange(101, dtype=np.float32))[None]
    assert components(depth, PAPER)[0].max() == 1


def test_what_is_continuous_grows_with_the_distance() -> None:
    # 6 mm by metre and three times 2.5 mm by square metre: 13.5 mm at 1 m, 144 mm at 4 m.
    config = BodyConfig()
    for near, far, parts in [(1.0, 1.012, 1), (1.0, 1.015, 2), (4.0, 4.12, 1), (4.0, 4.16, 2)]:
        assert components(np.array([[near, far]], np.float32), config)[0].max() == parts


def test_without_a_seed_the_largest_component_is_the_body() -> None:
    body = find_body(room(), BOX, None, BodyConfig())
    assert body is not None
    assert body.mask.sum() == 60 * 40 - 40 * 10
    assert body.depth_m[30, 20] == 0


def test_the_seed_tells_which_component_is_the_body() -> None:
    body = find_body(room(), BOX, 2.1, BodyConfig())
    assert body is not None
    assert body.mask.sum() == 40 * 10
    assert body.mask[10:50, 15:25].all()
    assert np.unique(body.depth_m).tolist() == [0, 2]


def test_a_seed_at_which_nothing_is_leaves_the_largest_within_reach() -> None:
    body = find_body(room(), BOX, 2.8, BodyConfig())
    assert body is not None
    assert body.mask.sum() == 40 * 10  # the wall is 1.2 m behind, no arm is as long
    assert find_body(room(), BOX, 9.0, BodyConfig()) is None


def test_a_box_may_reach_out_of_the_image() -> None:
    body = find_body(room(), np.array([-20.0, 5.0, 22.5, 900.0]), 2.0, BodyConfig())
    assert body is not None
    assert (body.left_px, body.top_px, body.mask.shape) == (0, 5, (55, 23))
    assert body.mask.sum() == 40 * 8


def test_a_hole_in_the_body_is_filled() -> None:
    depth = room()
    depth[20:22, 18:20] = 0
    body = find_body(depth, BOX, 2.0, BodyConfig())
    assert body is not None
    assert body.mask[20:22, 18:20].all()


def legs(beside: int = 25) -> U16:
    """A person whose far leg, 0.25 m behind the near one, shows beside it."""
    depth = room()
    depth[35:50, beside : beside + 4] = 2250
    return depth


def test_a_part_that_is_hidden_at_its_joint_belongs_to_the_body() -> None:
    body = find_body(legs(), BOX, 2.0, BodyConfig())
    assert body is not None
    assert body.mask.sum() == 40 * 10 + 15 * 4
    alone = find_body(legs(), BOX, 2.0, msgspec.structs.replace(BodyConfig(), join_m=0.0))
    assert alone is not None
    assert alone.mask.sum() == 40 * 10


@pytest.mark.parametrize(
    "depth",
    [
        pytest.param(legs(beside=36), id="it reaches the box's side: another's"),
        pytest.param(legs(beside=31), id="too far beside"),
        pytest.param(np.where(legs() == 2250, 2500, legs()).astype(np.uint16), id="too far behind"),
    ],
)
def test_what_else_is_near_does_not_belong_to_it(depth: U16) -> None:
    body = find_body(depth, BOX, 2.0, BodyConfig())
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
def test_a_box_that_holds_nothing_has_no_body(box: tuple[float, ...]) -> None:
    assert find_body(room(), np.array(box), 2.0, BodyConfig()) is None


@pytest.mark.parametrize("seed", [None, 2.0, np.nan, -1.0, np.inf])
def test_without_depth_there_is_no_body(seed: float | None) -> None:
    assert find_body(wall(0), BOX, seed, BodyConfig()) is None


def test_a_person_of_one_pixel() -> None:
    depth = wall(0)
    depth[30, 20] = 2000
    assert find_body(depth, BOX, 2.0, BodyConfig()) is None
    body = find_body(depth, BOX, 2.0, msgspec.structs.replace(PAPER, fill_passes=0))
    assert body is not None
    assert body.mask.sum() == 1


def test_a_body_covers_what_it_tells() -> None:
    # Whatever is in the image: depth only where the mask is, and the box is never left.
    chance = np.random.default_rng(0)
    for seed in [None, 1.0, 3.0] * 10:
        depth = (chance.random((60, 40)) * 4000).astype(np.uint16)
        depth[chance.random(depth.shape) < 0.3] = 0
        box = chance.uniform(-20, 80, 4)
        body = find_body(depth, box, seed, PAPER)
        if body is not None:
            assert np.array_equal(body.depth_m > 0, body.mask)
            height, width = body.mask.shape
            assert body.left_px >= 0
            assert body.top_px >= 0
            assert body.left_px + width <= 40
            assert body.top_px + height <= 60


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("fill_neighbours", 0),
        ("fill_passes", -1),
        ("vertices", -1),
        ("edge_m", float("nan")),
        ("reach_m", -1.0),
        ("neck_rows", (0.5, 0.2)),
        ("hips_heads", 0.5),
    ],
)
def test_wrong_numbers_are_refused(field: str, value: object) -> None:
    with pytest.raises(ValueError, match=field):
        msgspec.convert({**msgspec.to_builtins(BodyConfig()), field: value}, BodyConfig)
