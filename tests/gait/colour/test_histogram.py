"""Histograms by hand, and distances against NumPy."""

import numpy as np
import pytest

from people4d.messages import F64, U8
from services.gait.colour.histogram import (
    HueSaturationHistogram,
    hsv_patch,
    log_likelihoods,
    normalised_weights,
)
from tests.gait.numpy_histogram import bhattacharyya, histograms

RED, GREEN, GREY = (255, 0, 0), (0, 255, 0), (90, 90, 90)


def image(height: int = 40, width: int = 60) -> U8:
    """Red on the left half, green on the right, both of full saturation."""
    rgb = np.zeros((height, width, 3), np.uint8)
    rgb[:, : width // 2], rgb[:, width // 2 :] = RED, GREEN
    return rgb


def box(left: float, top: float, right: float, bottom: float) -> list[float]:
    return [(left + right) / 2, (top + bottom) / 2, right - left, bottom - top]


def test_a_histogram_by_hand() -> None:
    # Hue of red is 0 and of green 120 of 360 degrees: bin 120 / 360 * 20 = 6. Saturation is full:
    # bin 19. Bins are numbered hue * 20 + saturation: 19 and 139. A quarter of the box is green.
    histogram = HueSaturationHistogram((4, 5))
    (found,) = histogram(image(), np.array([box(0, 0, 40, 40)]))
    assert np.flatnonzero(found).tolist() == [19, 139]
    assert found[[19, 139]].tolist() == [0.75, 0.25]


def test_grey_has_no_saturation() -> None:
    rgb = np.full((8, 8, 3), GREY, np.uint8)
    (found,) = HueSaturationHistogram((4, 4))(rgb, np.array([box(0, 0, 8, 8)]))
    assert found[0] == 1.0


def test_points_outside_of_the_image_count_in_no_bin() -> None:
    histogram = HueSaturationHistogram((4, 4))
    boxes = np.array([box(-30, 0, 30, 40), box(500, 500, 520, 520), box(-90, -90, -50, -50)])
    found = histogram(image(), boxes)
    assert found.sum(axis=1).tolist() == [0.5, 0.0, 0.0]
    assert found[0, 19] == 0.5


def test_sampled_histogram_is_near_that_of_all_pixels() -> None:
    # Blobs of colour, as clothes are; every pixel counted is the reference.
    random = np.random.default_rng(0)
    rgb = np.repeat(np.repeat(random.integers(0, 255, (12, 10, 3), np.uint8), 20, 0), 20, 1)
    boxes = np.array([box(20, 30, 170, 230), box(3, 5, 90, 200)])
    exact = HueSaturationHistogram((150, 200))(rgb, boxes[:1])
    near = HueSaturationHistogram((16, 40))(rgb, boxes[:1])
    assert bhattacharyya(exact, near)[0] < 0.1
    other = HueSaturationHistogram((16, 40))(rgb, boxes[1:])
    assert bhattacharyya(exact, other)[0] > 0.3


@pytest.mark.parametrize("size", [1.0, 2.5, 1000.0])
def test_boxes_of_any_size_have_a_histogram(size: float) -> None:
    found = HueSaturationHistogram((16, 40))(image(), np.array([[10.0, 10.0, size, size]]))
    assert 0 < found.sum() <= 1


def test_weights_by_hand() -> None:
    # exp(-d^2 / 2) for sigma 1 and d = 0, 1: 1 and 0.60653, of 1.60653.
    found = normalised_weights(log_likelihoods(np.array([0.0, 1.0]), 1.0))
    assert found == pytest.approx([0.62246, 0.37754], abs=1e-5)
    # A small sigma would make all of them 0 if it were not for their ratios.
    assert normalised_weights(log_likelihoods(np.array([[0.9, 1.0]]), 0.001)).tolist() == [
        [1.0, 0.0]
    ]


def random_boxes() -> tuple[U8, F64]:
    """Noise of all colours, and boxes inside, across the border and outside."""
    random = np.random.default_rng(3)
    rgb = random.integers(0, 255, (120, 160, 3), np.uint8)
    centres, sizes = random.uniform(-40, 200, (60, 2)), random.uniform(4, 150, (60, 2))
    return rgb, np.concatenate([centres, sizes], axis=1)


def test_compiled_histograms_equal_numpy() -> None:
    rgb, boxes = random_boxes()
    histogram = HueSaturationHistogram((12, 32))
    assert np.array_equal(histogram(rgb, boxes), histograms(rgb, boxes, (12, 32), histogram))


def test_compiled_distances_equal_numpy() -> None:
    rgb, boxes = random_boxes()
    histogram = HueSaturationHistogram((12, 32))
    reference = histogram(rgb, np.array([box(20, 20, 90, 110)]))[0]
    found = histogram.measure_distances(hsv_patch(rgb, boxes), boxes, reference)
    plain = bhattacharyya(histograms(rgb, boxes, (12, 32), histogram), reference)
    np.testing.assert_allclose(found, plain, atol=1e-7)


def test_boxes_outside_of_the_image_have_distance_one() -> None:
    outside = np.array([box(500, 500, 520, 520)])
    histogram = HueSaturationHistogram((4, 4))
    found = histogram.measure_distances(hsv_patch(image(), outside), outside, np.full(400, 1 / 400))
    assert found.tolist() == [1.0]
