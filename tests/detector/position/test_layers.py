import math
from dataclasses import replace

import numpy as np

from people4d.messages import F64
from services.detector.position.layers import (
    DepthSamples,
    assign_layers,
)
from services.detector.position.proportions import BodySize

SQUARE: F64 = np.array([[10.0, 10.0], [20.0, 10.0], [20.0, 30.0], [10.0, 30.0], [15.0, 20.0]])


def samples(
    depth_m: list[float], size_depth_m: float | None = None, shift_px: float = 0.0
) -> DepthSamples:
    """Return five samples of equal weight, at the corners and in the middle of a square."""
    size = None if size_depth_m is None else BodySize(size_depth_m, size_depth_m, has_height=True)
    return DepthSamples(SQUARE + np.array([shift_px, 0.0]), np.array(depth_m), np.ones(5), size)


def depths(people: list[DepthSamples]) -> list[float | None]:
    return [None if layer is None else layer.depth_m for layer in assign_layers(people)]


def test_the_layer_of_most_samples_wins() -> None:
    # Three at 2.0 to 2.2 m, two on the wall at 4 m: median 2.1 m.
    assert depths([samples([2.0, 4.0, 2.1, 4.0, 2.2])]) == [2.1]


def test_samples_without_reading_do_not_count() -> None:
    nan = math.nan
    assert depths([samples([nan, 3.0, nan, nan, 3.1])]) == [3.05]
    assert depths([samples([nan] * 5)]) == [None]
    assert depths([]) == []


def test_layer_in_front_that_does_not_suit_the_size_loses() -> None:
    # As large as a person at 4 m; three samples read 2 m, two 4 m. At 2 m the size is off by
    # ln(0.5) / 0.2 = -3.5 sigma: exp(-6) is below 0.02. 3 * 0.02 = 0.06 < 2.
    assert depths([samples([2.0, 2.0, 2.0, 4.0, 4.0], size_depth_m=4.0)]) == [4.0]
    # A child of a size as at 2.6 m: ln(2 / 2.6) / 0.2 = -1.31, exp(-0.86) = 0.42; the wall:
    # ln(4 / 2.6) / 0.2 = 2.15, exp(-2.32) = 0.10.
    assert depths([samples([2.0, 2.0, 2.0, 4.0, 4.0], size_depth_m=2.6)]) == [2.0]


def test_child_is_half_as_large_and_people_are_not_smaller() -> None:
    assert depths([samples([2.0] * 5, size_depth_m=4.3)]) == [2.0]
    assert depths([samples([2.0] * 5, size_depth_m=4.5)]) == [None]
    # A narrow width alone may also be a person in profile.
    turned = replace(samples([2.0] * 5), size=BodySize(4.5, 4.5, has_height=False))
    assert depths([turned]) == [2.0]


def test_furniture_before_a_person_out_of_range_is_not_the_person() -> None:
    nan = math.nan
    # As large as a person at 6 m, where nothing is read; a cabinet at 2.8 m covers one sample of
    # five: 0.2 * 0.02 = 0.004 < 0.005. Two of five would be a child.
    assert depths([samples([2.8, nan, nan, nan, nan], size_depth_m=6.0)]) == [None]
    assert depths([samples([2.8, nan, nan, nan, 2.8], size_depth_m=6.0)]) == [2.8]


def test_samples_of_a_person_in_front_do_not_count_behind() -> None:
    # Both cover the same square: all samples of the front one are at 2 m, three of the other.
    front, behind = samples([2.0] * 5), samples([2.0, 2.0, 2.1, 3.0, 3.1])
    assert depths([front, behind]) == [2.0, 3.05]
    assert depths([behind, front]) == [3.05, 2.0]
    own = assign_layers([front, behind])[1]
    assert own is not None
    assert own.own.tolist() == [False, False, False, True, True]


def test_person_hidden_at_all_samples_has_no_layer() -> None:
    behind = samples([2.0, 2.0, 2.1, 2.0, 4.9])
    assert depths([samples([2.0] * 5), behind]) == [2.0, 4.9]
    front, hidden = samples([2.0] * 5), samples([2.0, math.nan, 2.1, 2.0, 2.0])
    assert depths([front, hidden]) == [2.0, None]


def test_people_side_by_side_share_no_samples() -> None:
    assert depths([samples([2.0] * 5), samples([2.1] * 5, shift_px=40.0)]) == [2.0, 2.1]


def test_an_outline_reaches_beyond_the_keypoints() -> None:
    # The other person's samples are 4 px right of the square: theirs, or the arm of the one before.
    def behind_an_arm(margin_px: float) -> float | None:
        front = replace(samples([2.0] * 5), margin_px=margin_px)
        pixels: F64 = np.array([[24.0, 15.0], [24.0, 20.0], [40.0, 20.0]])
        behind = DepthSamples(pixels, np.array([2.0, 2.0, 3.0]), np.ones(3))
        return depths([front, behind])[1]

    assert behind_an_arm(3.0) == 2.0
    assert behind_an_arm(5.0) == 3.0


def test_head_bent_to_the_camera_belongs_to_the_person() -> None:
    # In front: head at 1.8, chest at 2.0, hips at 2.2 m; behind, four samples are on that head.
    front = samples([1.8, 1.8, 2.2, 2.2, 2.0])
    head: F64 = np.array([[12.0, 11.0], [14.0, 11.0], [16.0, 11.0], [18.0, 11.0], [18.0, 4.0]])
    behind = DepthSamples(head, np.array([1.7, 1.7, 1.7, 1.7, 3.0]), np.ones(5))
    assert depths([front, behind]) == [2.0, 3.0]


def test_an_outline_holds_the_top_of_the_box() -> None:
    # Samples on the front person's hair, above all keypoints and below the top of the box.
    def behind_hair(crown_px: tuple[float, float] | None) -> float | None:
        front = replace(samples([2.0] * 5), crown_px=crown_px)
        pixels: F64 = np.array([[15.0, 6.0], [16.0, 7.0], [15.0, 0.0]])
        behind = DepthSamples(pixels, np.array([2.0, 2.0, 3.0]), np.ones(3))
        return depths([front, behind])[1]

    assert behind_hair(None) == 2.0
    assert behind_hair((15.0, 2.0)) == 3.0


def test_people_of_unknown_size_are_assigned_last() -> None:
    # All samples of the person without keypoints are on another one, with samples of the wall.
    known = samples([2.0, 2.0, 2.0, 2.0, 4.0], size_depth_m=2.0)
    unknown = samples([2.0, 2.0, 2.0, 2.0, 2.0])
    assert depths([unknown, known]) == [None, 2.0]


def test_nearer_layers_weigh_more_for_a_cut_off_person_without_size() -> None:
    # Two samples on an arm at 1.5 m, three on the wall at 4 m: 2 against 3 * 1.5 / 4 = 1.1.
    arm = samples([1.5, 1.5, 4.0, 4.0, 4.0])
    assert depths([arm, replace(arm, cut_off=True)]) == [4.0, 1.5]
    # One sample of something nearer does not outvote four of the person.
    assert depths([replace(samples([0.7, 2.0, 2.0, 2.0, 2.0]), cut_off=True)]) == [2.0]


def test_nearer_layer_fits_a_turned_person() -> None:
    # Shoulders as wide as at 6 m; four samples read 1.2 m: 4 * 1.2 / 6 = 0.8; one 4.5 m: 0.75.
    # With the torso's height it is at 4.5 m: 4 * 0.02 against exp(-(ln(0.75) / 0.2)^2 / 2) = 0.36.
    person = samples([1.2, 1.2, 1.2, 1.2, 4.5])
    assert depths([replace(person, size=BodySize(6.0, 6.0, has_height=False))]) == [1.2]
    assert depths([replace(person, size=BodySize(6.0, 6.0, has_height=True))]) == [4.5]


def test_layer_of_a_giant_is_refused() -> None:
    # As large as at 1.4 m: at 3 m the person would be 2.1 times as large as others.
    assert depths([samples([3.0] * 5, size_depth_m=1.4)]) == [None]
    assert depths([samples([3.0, 3.0, 3.0, 3.0, 1.3], size_depth_m=1.4)]) == [1.3]
    # One measure that is too large may be due to a wrong joint.
    torn = replace(samples([3.0] * 5), size=BodySize(1.4, 3.0, has_height=True))
    assert depths([torn]) == [3.0]


def test_samples_without_weight_have_no_layer() -> None:
    assert depths([replace(samples([2.0] * 5), weights=np.zeros(5))]) == [None]
