import math
from dataclasses import replace

import numpy as np
import pytest

from people4d.messages import F64
from services.detector.config import LayerConfig
from services.detector.position.layers import (
    DepthSamples,
    assign_layers,
    layer_variance,
    read_layer,
)
from services.detector.position.surface import DepthImage
from tests.detector.cameras import INFO

CONFIG = LayerConfig(half_m=0.25, size_sigma=0.2, misfit=0.02)
SQUARE: F64 = np.array([[10.0, 10.0], [20.0, 10.0], [20.0, 30.0], [10.0, 30.0], [15.0, 20.0]])


def samples(
    depth_m: list[float], size_depth_m: float | None = None, shift_px: float = 0.0
) -> DepthSamples:
    """Return five samples of equal weight, at the corners and in the middle of a square."""
    return DepthSamples(
        SQUARE + np.array([shift_px, 0.0]), np.array(depth_m), np.ones(5), size_depth_m
    )


def depths(people: list[DepthSamples]) -> list[float | None]:
    return [None if layer is None else layer.depth_m for layer in assign_layers(people, CONFIG)]


def test_the_layer_of_most_samples_wins() -> None:
    # Three at 2.0 to 2.2 m, two on the wall at 4 m: median 2.1 m.
    assert depths([samples([2.0, 4.0, 2.1, 4.0, 2.2])]) == [2.1]


def test_samples_without_reading_do_not_count() -> None:
    nan = math.nan
    assert depths([samples([nan, 3.0, nan, nan, 3.1])]) == [3.05]
    assert depths([samples([nan] * 5)]) == [None]
    assert depths([]) == []


def test_layer_in_front_that_does_not_suit_the_size_loses() -> None:
    # As large as somebody at 4 m; three samples read 2 m, two 4 m. At 2 m the size is off by
    # ln(0.5) / 0.2 = -3.5 sigma: exp(-6) is below 0.02. 3 * 0.02 = 0.06 < 2.
    assert depths([samples([2.0, 2.0, 2.0, 4.0, 4.0], size_depth_m=4.0)]) == [4.0]
    # A child of a size as at 2.6 m: ln(2 / 2.6) / 0.2 = -1.31, exp(-0.86) = 0.42; the wall:
    # ln(4 / 2.6) / 0.2 = 2.15, exp(-2.32) = 0.10.
    assert depths([samples([2.0, 2.0, 2.0, 4.0, 4.0], size_depth_m=2.6)]) == [2.0]


def test_size_does_not_matter_without_another_layer() -> None:
    assert depths([samples([2.0] * 5, size_depth_m=9.0)]) == [2.0]


def test_samples_of_a_person_in_front_do_not_count_behind() -> None:
    # Both cover the same square: all samples of the front one are at 2 m, three of the other.
    front, behind = samples([2.0] * 5), samples([2.0, 2.0, 2.1, 3.0, 3.1])
    assert depths([front, behind]) == [2.0, 3.05]
    assert depths([behind, front]) == [3.05, 2.0]
    own = assign_layers([front, behind], CONFIG)[1]
    assert own is not None
    assert own.own.tolist() == [False, False, False, True, True]


def test_person_hidden_at_all_samples_has_no_layer() -> None:
    assert depths([samples([2.0] * 5), samples([2.0, 2.0, 2.1, 2.0, 4.9], size_depth_m=2.0)]) == [
        2.0,
        4.9,
    ]
    front, hidden = samples([2.0] * 5), samples([2.0, math.nan, 2.1, 2.0, 2.0])
    assert depths([front, hidden]) == [2.0, None]


def test_people_side_by_side_share_no_samples() -> None:
    assert depths([samples([2.0] * 5), samples([2.1] * 5, shift_px=40.0)]) == [2.0, 2.1]


def test_at_an_outline_the_persons_side_is_read() -> None:
    # The window of 3x3 around (5, 5) has one column of the person at 2 m and two of the wall.
    depth_mm = np.full((10, 10), 4000, np.uint16)
    depth_mm[:, :5] = 2000
    image, edge = DepthImage(depth_mm, INFO), np.array([[5.0, 5.0]])
    np.testing.assert_allclose(read_layer(edge, 3, image, 2.1, 0.25), [2.0])
    np.testing.assert_allclose(read_layer(edge, 3, image, 4.0, 0.25), [4.0])
    assert np.isnan(read_layer(edge, 3, image, 3.0, 0.25)).all()


def test_an_outline_reaches_beyond_the_keypoints() -> None:
    # The other person's samples are 4 px right of the square: theirs, or the arm of the one before.
    def behind_an_arm(margin_px: float) -> float | None:
        front = replace(samples([2.0] * 5), margin_px=margin_px)
        pixels: F64 = np.array([[24.0, 15.0], [24.0, 20.0], [40.0, 20.0]])
        behind = DepthSamples(pixels, np.array([2.0, 2.0, 3.0]), np.ones(3))
        return depths([front, behind])[1]

    assert behind_an_arm(3.0) == 2.0
    assert behind_an_arm(5.0) == 3.0


def test_torso_samples_in_another_layer_add_variance() -> None:
    # Three samples at 2 m, two at 3 m: 0.4 * 0.6 * 1 m^2; on the torso only, with a reading.
    torn = samples([2.0, 2.0, 2.0, 3.0, 3.0])
    layer = assign_layers([torn], CONFIG)[0]
    assert layer is not None
    assert layer_variance(torn, layer, 0.25) == pytest.approx(0.24)
    limbs = replace(torn, weights=np.array([1.0, 1.0, 1.0, 0.5, 0.5]))
    assert layer_variance(limbs, layer, 0.25) == 0.0
    alike = samples([2.0, 2.1, 1.9, math.nan, 2.0])
    layer = assign_layers([alike], CONFIG)[0]
    assert layer is not None
    assert layer_variance(alike, layer, 0.25) == 0.0
