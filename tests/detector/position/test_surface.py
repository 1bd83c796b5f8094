import numpy as np
import pytest

from people4d.messages import F32, F64, U8
from services.detector.config import CONFIDENCE_MIN
from services.detector.models.base import InstanceMask
from services.detector.position.surface import (
    DepthImage,
    DepthWindows,
    keypoint_mean,
    mask_centroid,
    read_depth,
)
from tests import builders

# X = (u - 2) Z / 2, Y = (v - 2) Z / 2
INFO = builders.camera_info(width=5, height=5, fx=2.0, cx=2.0, cy=2.0)


TWO_M = DepthImage(np.full((5, 5), 2000, np.uint16), INFO)
NO_DEPTH = DepthImage(np.zeros((5, 5), np.uint16), INFO)


def keypoints(*points: tuple[int, float, float, float]) -> F32:
    """Return 17 keypoints; the given ones (index, u, v, confidence) are set."""
    array = np.zeros((17, 3), np.float32)
    for index, u, v, confidence in points:
        array[index] = u, v, confidence
    return array


def check(position: F64 | None, x: float, y: float, z: float) -> None:
    assert position is not None
    np.testing.assert_allclose(position, np.array([x, y, z]), atol=1e-12)


def test_centroid_of_a_mask() -> None:
    # 3x3 pixels around column 1 + 1 = 2 and row 2 + 1 = 3; X = 0, Y = (3 - 2) * 2 / 2 = 1, Z = 2.
    depth = np.zeros((5, 5), np.uint16)
    depth[3, 2] = 2000
    mask = InstanceMask(np.ones((3, 3), np.uint8), x_px=1, y_px=2)
    check(mask_centroid(mask, DepthImage(depth, INFO)), 0.0, 1.0, 2.0)


def test_centroid_is_not_rounded_before_deprojection() -> None:
    # Columns 1, 2 and 3, 3 again: u = (1 + 2 + 3 + 3) / 4 = 2.25, v = (2 + 2 + 2 + 1) / 4 = 1.75;
    # read at (2, 2): X = 0.25 * 4 / 2 = 0.5, Y = -0.25 * 4 / 2 = -0.5.
    window = np.zeros((5, 5), np.uint8)
    window[2, 1:4] = window[1, 3] = 1
    depth = np.zeros((5, 5), np.uint16)
    depth[2, 2] = 4000
    position = mask_centroid(InstanceMask(window, 0, 0), DepthImage(depth, INFO))
    check(position, 0.5, -0.5, 4.0)


def test_centroid_outside_of_the_mask_is_skipped() -> None:
    ring = np.ones((5, 5), np.uint8)
    ring[2, 2] = 0
    assert mask_centroid(InstanceMask(ring, 0, 0), TWO_M) is None


@pytest.mark.parametrize(
    ("reading_mm", "valid"), [(0, False), (1, True), (5000, True), (5001, False)]
)
def test_centroid_without_valid_reading_is_skipped(reading_mm: int, valid: bool) -> None:
    depth = np.full((5, 5), 2000, np.uint16)
    depth[2, 2] = reading_mm
    mask = InstanceMask(np.ones((5, 5), np.uint8), 0, 0)
    assert (mask_centroid(mask, DepthImage(depth, INFO)) is not None) == valid


def test_an_empty_mask_has_no_centroid() -> None:
    empty: U8 = np.zeros((5, 5), np.uint8)
    depth = np.full((5, 5), 2000, np.uint16)
    assert mask_centroid(InstanceMask(empty, 0, 0), DepthImage(depth, INFO)) is None


def test_mean_of_two_keypoints() -> None:
    # (0, 2) at 2 m: X = -2 * 2 / 2 = -2; (4, 2) at 4 m: X = 2 * 4 / 2 = 4; mean (1, 0, 3).
    depth = np.zeros((5, 5), np.uint16)
    depth[2, 0], depth[2, 4] = 2000, 4000
    points = keypoints((5, 0, 2, 0.9), (6, 4, 2, 0.7))
    check(keypoint_mean(points, DepthImage(depth, INFO), CONFIDENCE_MIN), 1.0, 0.0, 3.0)


def test_only_keypoints_above_the_confidence_count() -> None:
    depth = np.full((5, 5), 2000, np.uint16)
    points = keypoints((0, 2, 2, 0.61), (5, 0, 0, 0.6), (6, 4, 4, 0.1))
    position = keypoint_mean(points, DepthImage(depth, INFO), CONFIDENCE_MIN)
    check(position, 0.0, 0.0, 2.0)


def test_keypoints_without_reading_or_outside_of_the_image_do_not_count() -> None:
    depth = np.full((5, 5), 2000, np.uint16)
    depth[0, 0], depth[0, 1] = 0, 5001
    points = keypoints(
        (0, 2, 2, 0.9),
        (1, 0, 0, 0.9),
        (2, 1, 0, 0.9),
        (3, -0.51, 2, 0.9),
        (4, 4.51, 2, 0.9),
        (5, 2, 1e9, 0.9),
        (6, -1e9, 2, 0.9),
    )
    position = keypoint_mean(points, DepthImage(depth, INFO), CONFIDENCE_MIN)
    check(position, 0.0, 0.0, 2.0)


def test_without_any_valid_keypoint_there_is_no_position() -> None:
    points = keypoints((0, 2, 2, 0.9), (5, 1, 1, 0.9))
    assert keypoint_mean(points, NO_DEPTH, CONFIDENCE_MIN) is None
    uncertain = keypoints((0, 2, 2, 0.5))
    assert keypoint_mean(uncertain, TWO_M, CONFIDENCE_MIN) is None


def test_a_window_reads_the_median_of_valid_readings() -> None:
    # Around (0, 0) in the image: 0 (none), 1000, 3000, 6000 (too far); median 2 m.
    depth = np.zeros((5, 5), np.uint16)
    depth[0, 1], depth[1, 0], depth[1, 1] = 1000, 3000, 6000
    pixels = np.array([[0.0, 0.0], [4.0, 4.0]])
    np.testing.assert_allclose(
        read_depth(pixels, DepthImage(depth, INFO), window_px=3), [2.0, np.nan]
    )
    np.testing.assert_allclose(read_depth(pixels, DepthImage(depth, INFO)), [np.nan, np.nan])


def test_windows_of_several_sizes_and_ranges_are_read_as_each_alone() -> None:
    rng = np.random.default_rng(3)
    depth = rng.integers(0, 4000, (48, 64)).astype(np.uint16)
    depth[rng.random(depth.shape) < 0.2] = 0
    image = DepthImage(depth, INFO)
    pixels = rng.uniform(-8, 70, (40, 2))
    sides = rng.choice([1, 3, 5, 9], 40)
    nearest_m = rng.uniform(-0.5, 2.0, 40)
    farthest_m = nearest_m + rng.uniform(0.1, 3.0, 40)
    windows = DepthWindows(pixels, image, sides)
    sizes, (median_m, found) = windows.sizes(), windows.medians(nearest_m, farthest_m)
    for k, (u, v) in enumerate(np.rint(pixels).astype(int)):
        half = sides[k] // 2
        rows = slice(max(v - half, 0), max(v + half + 1, 0))
        window_m = depth[rows, max(u - half, 0) : max(u + half + 1, 0)] / 1000
        counted = window_m[(window_m > 0) & (window_m >= nearest_m[k])]
        counted = counted[counted <= farthest_m[k]]
        expected_m = np.median(counted) if counted.size else np.nan
        np.testing.assert_allclose(median_m[k], expected_m)
        assert (found[k], sizes[k]) == (counted.size, window_m.size)
