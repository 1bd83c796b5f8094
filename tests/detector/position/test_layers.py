import math
from dataclasses import replace

import numpy as np
import pytest

from people4d.messages import F64
from services.detector.position.layers import LayerRule, Places, disagreement, read_layer, settle

RULE = LayerRule(half_m=0.25, size_sigma=0.2, misfit=0.02)
SQUARE: F64 = np.array([[10.0, 10.0], [20.0, 10.0], [20.0, 30.0], [10.0, 30.0], [15.0, 20.0]])


def places(depth_m: list[float], common_m: float | None = None, shift_px: float = 0.0) -> Places:
    """Return five places of equal weight, at the corners and in the middle of a square."""
    return Places(SQUARE + np.array([shift_px, 0.0]), np.array(depth_m), np.ones(5), common_m)


def depths(people: list[Places]) -> list[float | None]:
    return [None if layer is None else layer.depth_m for layer in settle(people, RULE)]


def test_the_layer_of_most_places_wins() -> None:
    # Three at 2.0 to 2.2 m, two on the wall at 4 m: median 2.1 m.
    assert depths([places([2.0, 4.0, 2.1, 4.0, 2.2])]) == [2.1]


def test_places_without_reading_do_not_count() -> None:
    nan = math.nan
    assert depths([places([nan, 3.0, nan, nan, 3.1])]) == [3.05]
    assert depths([places([nan] * 5)]) == [None]
    assert depths([]) == []


def test_whoever_is_in_front_would_have_to_be_a_dwarf() -> None:
    # As large as somebody at 4 m; three places read 2 m, two 4 m. At 2 m the size is off by
    # ln(0.5) / 0.2 = -3.5 sigma: exp(-6) is below 0.02. 3 * 0.02 = 0.06 < 2.
    assert depths([places([2.0, 2.0, 2.0, 4.0, 4.0], common_m=4.0)]) == [4.0]
    # A child that looks as if at 2.6 m: ln(2 / 2.6) / 0.2 = -1.31, exp(-0.86) = 0.42; the wall:
    # ln(4 / 2.6) / 0.2 = 2.15, exp(-2.32) = 0.10.
    assert depths([places([2.0, 2.0, 2.0, 4.0, 4.0], common_m=2.6)]) == [2.0]


def test_where_nothing_else_is_read_the_size_does_not_matter() -> None:
    assert depths([places([2.0] * 5, common_m=9.0)]) == [2.0]


def test_what_belongs_to_somebody_in_front_is_not_read_as_the_one_behind() -> None:
    # Both look into the same square: all of the front one's places are at 2 m, three of the other.
    front, behind = places([2.0] * 5), places([2.0, 2.0, 2.1, 3.0, 3.1])
    assert depths([front, behind]) == [2.0, 3.05]
    assert depths([behind, front]) == [3.05, 2.0]
    own = settle([front, behind], RULE)[1]
    assert own is not None
    assert own.own.tolist() == [False, False, False, True, True]


def test_whoever_is_hidden_in_all_places_has_no_layer() -> None:
    assert depths([places([2.0] * 5), places([2.0, 2.0, 2.1, 2.0, 4.9], common_m=2.0)]) == [
        2.0,
        4.9,
    ]
    front, hidden = places([2.0] * 5), places([2.0, math.nan, 2.1, 2.0, 2.0])
    assert depths([front, hidden]) == [2.0, None]


def test_people_side_by_side_do_not_take_places_from_each_other() -> None:
    assert depths([places([2.0] * 5), places([2.1] * 5, shift_px=40.0)]) == [2.0, 2.1]


def test_at_an_outline_the_persons_side_is_read() -> None:
    # The window of 3x3 around (5, 5) has one column of the person at 2 m and two of the wall.
    depth_mm = np.full((10, 10), 4000, np.uint16)
    depth_mm[:, :5] = 2000
    edge: F64 = np.array([[5.0, 5.0]])
    np.testing.assert_allclose(read_layer(edge, 3, depth_mm, 2.1, 0.25), [2.0])
    np.testing.assert_allclose(read_layer(edge, 3, depth_mm, 4.0, 0.25), [4.0])
    assert np.isnan(read_layer(edge, 3, depth_mm, 3.0, 0.25)).all()


def test_numbers_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match="half_m: expected a number > 0, got 0"):
        LayerRule(half_m=0)
    with pytest.raises(ValueError, match="misfit: expected above 0 to 1, got 2"):
        LayerRule(misfit=2)


def test_an_outline_reaches_beyond_the_keypoints() -> None:
    # The other person's places are 4 px right of the square: theirs, or the arm of the one before.
    def behind_an_arm(margin_px: float) -> float | None:
        front = replace(places([2.0] * 5), margin_px=margin_px)
        pixels: F64 = np.array([[24.0, 15.0], [24.0, 20.0], [40.0, 20.0]])
        behind = Places(pixels, np.array([2.0, 2.0, 3.0]), np.ones(3))
        return depths([front, behind])[1]

    assert behind_an_arm(3.0) == 2.0
    assert behind_an_arm(5.0) == 3.0


def test_places_in_another_layer_make_doubt() -> None:
    # Three places at 2 m, two at 3 m: 0.4 * 0.6 * 1 m^2; of the trunk only, and of what is read.
    torn = places([2.0, 2.0, 2.0, 3.0, 3.0])
    layer = settle([torn], RULE)[0]
    assert layer is not None
    assert disagreement(torn, layer, 0.25) == pytest.approx(0.24)
    limbs = replace(torn, weights=np.array([1.0, 1.0, 1.0, 0.5, 0.5]))
    assert disagreement(limbs, layer, 0.25) == 0.0
    whole = places([2.0, 2.1, 1.9, math.nan, 2.0])
    layer = settle([whole], RULE)[0]
    assert layer is not None
    assert disagreement(whole, layer, 0.25) == 0.0
