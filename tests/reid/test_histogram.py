import numpy as np
import pytest

from people4d.messages import F32, HIDDEN_RGB, U8, Crop
from services.reid.histogram import BINS, PART_WEIGHTS, HistogramEmbedder
from services.tracker.strongsort3d.config import COSINE_DISTANCE_MAX

RED, BLUE, GREEN = (200, 20, 20), (20, 20, 200), (20, 180, 20)
WHITE, GREY, BLACK = (240, 240, 240), (120, 120, 120), (12, 12, 12)
Colour = tuple[int, int, int]


def image_of(head: Colour, torso: Colour, legs: Colour, height: int = 100, width: int = 40) -> U8:
    """Return a person with parts that end at 18 % and 48 % of the height."""
    rgb = np.zeros((height, width, 3), np.uint8)
    rgb[:] = legs
    rgb[: round(0.48 * height)] = torso
    rgb[: round(0.18 * height)] = head
    return rgb


def crop(rgb: U8, mask: U8 | None = None, keypoints: F32 | None = None) -> Crop:
    return Crop(detection=0, rgb=rgb, mask=mask, keypoints=keypoints)


def distance(a: Crop, b: Crop) -> float:
    first, second = HistogramEmbedder().embed([a, b])
    return 1 - float(first @ second)


def test_vectors_have_unit_length() -> None:
    rng = np.random.default_rng(0)
    sizes = ((1, 1), (3, 200), (96, 30), (256, 90), (500, 2))
    crops = [crop(rng.integers(0, 256, (*size, 3)).astype(np.uint8)) for size in sizes]
    vectors = HistogramEmbedder().embed(crops)
    assert vectors.dtype == np.float32
    assert vectors.shape == (5, len(PART_WEIGHTS) * BINS)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-6)


def test_a_changed_order_of_crops_changes_the_order_of_rows() -> None:
    rng = np.random.default_rng(0)
    crops = [crop(rng.integers(0, 256, (60, 20, 3)).astype(np.uint8)) for _ in range(6)]
    order = rng.permutation(6)
    rows = HistogramEmbedder().embed(crops)
    np.testing.assert_array_equal(HistogramEmbedder().embed([crops[i] for i in order]), rows[order])


def test_a_part_of_another_colour_counts_by_its_weight() -> None:
    # 0.05 of a part's pixels spread over 56 bins make each at least q = 0.05 / 1.05 / 56 = 0.00085.
    # Two colours that share no bin and fill n each have a Bhattacharyya coefficient of
    # 2 n sqrt(0.952 / n * q) + (56 - 2 n) q: 0.10 for n = 1, 0.15 for n = 4. Another torso (weight
    # 0.5) then makes a distance of 0.5 (1 - 0.15) = 0.42 to 0.5 (1 - 0.10) = 0.45.
    one, other = crop(image_of(WHITE, RED, BLUE)), crop(image_of(WHITE, GREEN, BLUE))
    assert 0.41 < distance(one, other) < 0.46
    legs = crop(image_of(WHITE, RED, GREEN))
    assert distance(one, legs) == pytest.approx(0.35 / 0.5 * distance(one, other), abs=0.02)


def test_clothes_without_hue_differ() -> None:
    white, grey, black = (crop(image_of(GREY, shirt, BLUE)) for shirt in (WHITE, GREY, BLACK))
    assert min(distance(white, grey), distance(grey, black), distance(white, black)) > 0.25


def test_hue_of_black_clothes_is_not_trusted() -> None:
    # Two blacks whose noise points to opposite hues with full saturation.
    one, other = crop(image_of(GREY, (12, 0, 0), BLUE)), crop(image_of(GREY, (0, 12, 12), BLUE))
    assert distance(one, other) < 0.05


def test_red_has_no_seam_in_hue() -> None:
    # Hues of 357 and 3 degrees lie on either side of 0.
    one, other = (
        crop(image_of(GREY, (200, 20, 29), BLUE)),
        crop(image_of(GREY, (200, 29, 20), BLUE)),
    )
    assert distance(one, other) < 0.1


def test_light_hardly_matters_to_coloured_clothes() -> None:
    bright = image_of(RED, GREEN, BLUE)
    assert distance(crop(bright), crop((bright * 0.7).astype(np.uint8))) < 0.1


def test_size_hardly_matters() -> None:
    small = crop(image_of(WHITE, RED, BLUE, height=50, width=20))
    assert distance(small, crop(image_of(WHITE, RED, BLUE, height=250, width=100))) < 0.03


def test_the_mask_keeps_the_background_out() -> None:
    mask = np.zeros((100, 40), np.uint8)
    mask[:, 10:30] = 1
    images = []
    for background in (GREEN, WHITE):
        rgb = image_of(GREY, RED, BLUE)
        rgb[mask == 0] = background
        images.append(rgb)
    masked = distance(crop(images[0], mask), crop(images[1], mask))
    assert masked < 0.05  # the outline is mixed when the image_of is scaled
    assert masked < distance(crop(images[0]), crop(images[1])) / 3


def standing(width: int = 40) -> F32:
    """Return keypoints of a person in the middle of a crop of 100 rows: shoulders 18, hips 48."""
    middle = width / 2
    keypoints = np.zeros((17, 3), np.float32)
    keypoints[:5] = middle, 9, 0.9
    rows = {5: 18, 7: 33, 9: 48, 11: 48, 13: 70, 15: 96}
    for index, row in rows.items():
        keypoints[index] = middle + 4, row, 0.9
        keypoints[index + 1] = middle - 4, row, 0.9
    return keypoints


def test_the_skeleton_keeps_the_background_out() -> None:
    inside = np.zeros((100, 40), bool)
    inside[:, 12:28] = True
    images = []
    for background in (GREEN, WHITE):
        rgb = image_of(GREY, RED, BLUE)
        rgb[~inside] = background
        images.append(crop(rgb, keypoints=standing()))
    assert distance(*images) < 0.02


def test_keypoints_divide_the_body() -> None:
    # The lower body is cut off by the image: shoulders in row 36, hips in row 96.
    rgb = image_of(GREY, RED, BLUE, height=200)[:100]
    keypoints = standing() * np.array([1, 2, 1], np.float32)
    full = crop(image_of(GREY, RED, BLUE), keypoints=standing())
    by_keypoints = distance(full, crop(rgb, keypoints=keypoints))
    uncertain = keypoints * np.array([1, 1, 0.1], np.float32)
    assert by_keypoints < distance(full, crop(rgb, keypoints=uncertain))
    assert by_keypoints < COSINE_DISTANCE_MAX["histogram"]


def test_wild_keypoints_do_no_harm() -> None:
    keypoints = standing()
    keypoints[:, :2] = 9e5
    keypoints[3, :2] = -9e5
    vectors = HistogramEmbedder().embed([crop(image_of(GREY, RED, BLUE), keypoints=keypoints)])
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-6)


def test_an_empty_mask_counts_as_none() -> None:
    rgb = image_of(GREY, RED, BLUE)
    assert distance(crop(rgb, np.zeros((100, 40), np.uint8)), crop(rgb)) == pytest.approx(0)


def test_hidden_pixels_do_not_count() -> None:
    full = crop(image_of(WHITE, RED, BLUE))
    behind_green, blanked = image_of(WHITE, RED, BLUE), image_of(WHITE, RED, BLUE)
    behind_green[:, :15], blanked[:, :15] = GREEN, HIDDEN_RGB
    assert distance(full, crop(blanked)) < 0.001
    assert distance(full, crop(behind_green)) > 0.05


def test_crop_that_is_hidden_throughout_has_a_vector() -> None:
    hidden = image_of(HIDDEN_RGB, HIDDEN_RGB, HIDDEN_RGB)
    (vector,) = HistogramEmbedder().embed([crop(hidden)])
    assert np.linalg.norm(vector) == pytest.approx(1, abs=1e-6)
