import numpy as np

from people4d.messages import F32, HIDDEN_RGB, U8, U16
from services.detector.crops import crop_person, cut_box, hidden_pixels
from services.detector.models.base import DetectedPerson, InstanceMask


def image(height: int = 20, width: int = 30) -> U8:
    """Return an image whose red is the column and whose green is the row."""
    rows, columns = np.mgrid[:height, :width]
    return np.stack([columns, rows, 0 * rows], axis=2).astype(np.uint8)


def box(*edges: float) -> F32:
    return np.array(edges, np.float32)


def test_a_box_covers_every_pixel_it_touches_inside_the_image() -> None:
    assert cut_box(box(2.5, 3.0, 6.1, 7.0), (20, 30)) == (2, 3, 7, 7)
    assert cut_box(box(-5, -5, 100, 100), (20, 30)) == (0, 0, 30, 20)


def test_the_crop_is_the_box_cut_to_the_image() -> None:
    crop = crop_person(3, DetectedPerson(0.9, box(-4, 15, 5, 40)), image(), 256)
    assert crop is not None
    assert crop.detection == 3
    np.testing.assert_array_equal(crop.rgb, image()[15:20, 0:5])


def test_a_box_outside_of_the_image_gives_no_crop() -> None:
    for edges in ((30, 0, 40, 20), (-9, 0, 0, 20), (0, -9, 9, 0), (5, 20, 9, 30), (9, 9, 9, 9)):
        assert crop_person(0, DetectedPerson(0.9, box(*edges)), image(), 256) is None


def test_mask_and_keypoints_move_into_the_crop() -> None:
    # Pixel (7, 9) of the image is (7 - 5, 9 - 6) = (2, 3) of the crop; the mask's window hangs over
    # the crop's left edge by two columns.
    keypoints = np.zeros((17, 3), np.float32)
    keypoints[0] = 7, 9, 0.8
    window = np.ones((2, 3), np.uint8)
    person = DetectedPerson(0.9, box(5, 6, 15, 16), keypoints, InstanceMask(window, x_px=3, y_px=8))
    crop = crop_person(0, person, image(), 256)
    assert crop is not None
    assert crop.keypoints is not None
    assert crop.mask is not None
    np.testing.assert_allclose(crop.keypoints[0], [2, 3, 0.8])
    expected = np.zeros((10, 10), np.uint8)
    expected[2:4, 0:1] = 1
    np.testing.assert_array_equal(crop.mask, expected)
    np.testing.assert_array_equal(keypoints[0], np.array([7, 9, 0.8], np.float32))  # not changed


def test_a_mask_beside_the_box_is_empty() -> None:
    person = DetectedPerson(
        0.9, box(5, 6, 15, 16), mask=InstanceMask(np.ones((4, 4), np.uint8), 20, 0)
    )
    crop = crop_person(0, person, image(), 256)
    assert crop is not None
    assert crop.mask is not None
    assert not crop.mask.any()


def test_a_high_crop_is_scaled_down() -> None:
    # 40 of 80 rows: half. Pixels 2 and 3 become pixel 1: 2.5 -> (2.5 + 0.5) / 2 - 0.5 = 1.
    keypoints = np.full((17, 3), 2.5, np.float32)
    mask = InstanceMask(np.ones((80, 10), np.uint8), 0, 0)
    person = DetectedPerson(0.9, box(0, 0, 20, 80), keypoints, mask)
    crop = crop_person(0, person, image(80, 20), 40)
    assert crop is not None
    assert crop.mask is not None
    assert crop.keypoints is not None
    assert crop.rgb.shape == (40, 10, 3)
    assert crop.mask.shape == (40, 10)
    assert crop.mask[:, :5].all()
    assert not crop.mask[:, 5:].any()
    np.testing.assert_allclose(crop.keypoints[0, :2], [1, 1])


def test_a_very_narrow_box_keeps_a_pixel() -> None:
    crop = crop_person(0, DetectedPerson(0.9, box(3, 0, 4, 80)), image(80, 20), 16)
    assert crop is not None
    assert crop.rgb.shape == (16, 1, 3)


def depths(left_mm: int, right_mm: int) -> U16:
    """Return depth of 20x30 pixels: columns before 10, and from 10 on."""
    depth_mm = np.full((20, 30), right_mm, np.uint16)
    depth_mm[:, :10] = left_mm
    return depth_mm


def test_occluders_of_a_person_are_blanked() -> None:
    # Columns 5 to 9 of the box from 5 to 25 are at 1 m, the person at 2 m.
    person = DetectedPerson(0.9, box(5, 0, 25, 20))
    hidden = hidden_pixels(person.box_xyxy_px, depths(1000, 2000), 1.6)
    crop = crop_person(0, person, image(), 256, hidden)
    assert crop is not None
    assert (crop.rgb[:, :5] == HIDDEN_RGB).all()
    np.testing.assert_array_equal(crop.rgb[:, 5:], image()[:, 10:25])
    half = crop_person(0, person, image(), 10, hidden)
    assert half is not None
    assert (half.rgb[:, :2] == HIDDEN_RGB).all()
    assert not (half.rgb[:, 3:] == HIDDEN_RGB).all(axis=2).any()


def test_background_and_unread_pixels_are_not_blanked() -> None:
    for left_mm in (2000, 5000, 0):
        assert hidden_pixels(box(5, 0, 25, 20), depths(left_mm, 2000), 1.6) is None
    assert hidden_pixels(box(5, 0, 25, 20), 0 * depths(1, 1), 1.6) is None


def test_nothing_is_blanked_where_the_depth_must_be_wrong() -> None:
    # 16 of 20 columns before the person; no depth; none inside the image; no limit.
    assert hidden_pixels(box(5, 0, 25, 20), depths(2000, 1000), 1.6) is None
    assert hidden_pixels(box(40, 0, 50, 20), depths(1000, 2000), 1.6) is None
    assert hidden_pixels(box(5, 0, 25, 20), depths(1000, 2000), -np.inf) is None
    assert hidden_pixels(box(5, 0, 25, 20), depths(1000, 2000), np.nan) is None
