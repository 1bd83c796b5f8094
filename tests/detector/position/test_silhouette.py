from pathlib import Path

import cv2
import numpy as np
import pytest

from people4d.messages import F32, U8, U16
from services.detector.models.base import DetectedPerson, InstanceMask
from services.detector.position.silhouette import fill_holes, grow_mask
from services.detector.position.surface import DepthImage
from tests.detector.cameras import INFO
from tests.two_people import truth_of


def person_at(left: int, right: int, box: tuple[float, ...] = (0, 0, 40, 60)) -> DetectedPerson:
    """Return a person with shoulders in row 20 and hips in row 40 at these columns."""
    keypoints = np.zeros((17, 3), np.float32)
    for index, u, v in ((5, right, 20), (6, left, 20), (11, right, 40), (12, left, 40)):
        keypoints[index] = u, v, 0.9
    return DetectedPerson(0.9, np.array(box, np.float32), keypoints)


def grown(person: DetectedPerson, depth: U16) -> U8:
    """Return the grown mask in the whole image."""
    mask = grow_mask(person, DepthImage(depth, INFO))
    assert mask is not None
    return paste(mask, depth.shape)


def paste(mask: InstanceMask, shape: tuple[int, ...]) -> U8:
    image = np.zeros(shape, np.uint8)
    height, width = mask.window.shape
    image[mask.y_px : mask.y_px + height, mask.x_px : mask.x_px + width] = mask.window
    return image


def body(depth_mm: int = 2000, left: int = 10, right: int = 20) -> U16:
    """Return an image in which rows 10 to 49 of some columns are a body, the rest is not read."""
    depth = np.zeros((60, 40), np.uint16)
    depth[10:50, left:right] = depth_mm
    return depth


def test_a_hole_gets_the_median_of_its_neighbours() -> None:
    # Around the middle: 1000, 2000, 4000 (0 is no reading); median 2000. The corner has 4000 and
    # 2000 next to it (the middle is no reading): median 3000. Far holes stay.
    depth = np.zeros((3, 5), np.uint16)
    depth[0, 0], depth[0, 1], depth[1, 2] = 1000, 2000, 4000
    filled = fill_holes(depth)
    assert filled[1, 1] == 2000
    assert filled[0, 2] == 3000
    assert filled[2, 0] == 0
    assert filled[1, 4] == 0
    assert (filled[0, 0], filled[0, 1], filled[1, 2]) == (1000, 2000, 4000)


def test_large_readings_do_not_overflow() -> None:
    depth = np.zeros((1, 3), np.uint16)
    depth[0, 0] = depth[0, 2] = 65535
    assert fill_holes(depth)[0, 1] == 65535


def test_the_wall_behind_the_person_is_left_out() -> None:
    depth = np.full((60, 40), 4000, np.uint16)
    depth[10:50, 10:20] = 2000
    np.testing.assert_array_equal(grown(person_at(12, 17), depth), body() > 0)


def test_joints_beyond_the_outline_are_pulled_onto_the_body() -> None:
    # Columns 8 and 21 are wall; pulled by 0.3 x 6.5 px they are 9.95 and 19.05.
    depth = np.full((60, 40), 4000, np.uint16)
    depth[10:50, 10:20] = 2000
    np.testing.assert_array_equal(grown(person_at(8, 21), depth), body() > 0)


def test_the_neighbour_at_the_same_distance_is_left_out() -> None:
    # Both at 2 m with three unread columns between; filling takes one from either side.
    depth = body() + body(left=23, right=33)
    mask = grown(person_at(12, 17), depth)
    assert mask[10:50, 10:20].all()
    assert mask[:, 22:].sum() == 0


@pytest.mark.parametrize(("near_mm", "step_mm"), [(900, 10), (2000, 40)])
def test_a_slope_belongs_to_the_body_and_a_step_does_not(near_mm: int, step_mm: int) -> None:
    # Neighbours are joined below 10 mm [Liu 2018], from 1 m on below 0.01 z^2: 40 mm at 2 m. The
    # slope has 8 mm a column, about 2 m; then comes a step 3 mm beyond the limit at the torso.
    depth = np.zeros((60, 40), np.uint16)
    depth[10:50, 10:20] = near_mm + 8 * np.arange(-5, 5)
    depth[10:50, 20:30] = near_mm + 32 + step_mm + 3
    mask = grown(person_at(12, 17), depth)
    assert mask[10:50, 10:20].all()
    assert mask[10:50, 20:30].sum() == 0
    depth[10:50, 20:30] = near_mm + 32 + step_mm - 3
    assert grown(person_at(12, 17), depth)[10:50, 20:30].all()


def test_nothing_beyond_the_reach_belongs_to_the_body() -> None:
    # Depth grows 19 mm a row from 2 m in row 0, less than 0.01 z^2. Seeds lie 30 % of the way from
    # rows 20 and 40 to 30: rows 23, 30 and 37, median 2.57 m. A reach of 0.4 m is 21 rows: 9 to 51.
    depth = np.zeros((60, 40), np.uint16)
    depth[:, 10:20] = (2000 + 19 * np.arange(60))[:, None]
    mask = grown(person_at(12, 17), depth)
    assert mask[9:52, 10:20].all()
    assert not mask[:9].any()
    assert not mask[52:].any()


def test_the_mask_stays_in_the_box_and_the_image() -> None:
    depth = np.full((60, 40), 2000, np.uint16)
    mask = grow_mask(person_at(12, 17, (8.5, -20, 21.2, 500)), DepthImage(depth, INFO))
    assert mask is not None
    assert (mask.x_px, mask.y_px, mask.window.shape) == (8, 0, (60, 14))
    assert mask.window.all()


def test_parts_that_hold_a_torso_keypoint_are_joined() -> None:
    # An arm in front of the body cuts it in two: shoulders above, hips below.
    depth = body()
    depth[28:32, 5:25] = 1800
    mask = grown(person_at(12, 17), depth)
    assert mask[10:28, 10:20].all()
    assert mask[32:50, 10:20].all()


def test_without_seeds_there_is_no_mask() -> None:
    person = person_at(12, 17)
    assert grow_mask(person, DepthImage(np.zeros((60, 40), np.uint16), INFO)) is None
    assert person.keypoints is not None
    uncertain = person.keypoints * np.array([1, 1, 0.1], np.float32)
    assert (
        grow_mask(DetectedPerson(0.9, person.box_xyxy_px, uncertain), DepthImage(body(), INFO))
        is None
    )
    assert grow_mask(DetectedPerson(0.9, person.box_xyxy_px), DepthImage(body(), INFO)) is None
    assert grow_mask(person_at(12, 17, (50, 0, 90, 60)), DepthImage(body(), INFO)) is None
    assert grow_mask(person_at(12, 17, (25, 0, 40, 60)), DepthImage(body(), INFO)) is None


@pytest.mark.slow
def test_masks_of_the_simulated_room(shared: Path) -> None:
    # Measured over all frames with MoveNet's keypoints: median overlap 0.86, tenth percentile 0.80.
    folder = shared / "data" / "lab" / "two"
    names = ("vis", "kpvis", "kp2d", "bbox", "masks")
    truth = {name: truth_of(shared, name) for name in names}
    overlaps = []
    for frame in range(0, 150, 15):
        depth = np.asarray(cv2.imread(str(folder / "depth" / f"{frame:05d}.png"), -1), np.uint16)
        for index in np.flatnonzero(truth["vis"][frame] > 0.9):
            visible: F32 = truth["kpvis"][frame, index].astype(np.float32)
            keypoints = np.column_stack([truth["kp2d"][frame, index], visible]).astype(np.float32)
            person = DetectedPerson(1.0, truth["bbox"][frame, index], keypoints)
            mask = grow_mask(person, DepthImage(depth, INFO))
            assert mask is not None
            got, want = paste(mask, depth.shape) > 0, truth["masks"][frame] == index + 1
            overlaps.append((got & want).sum() / (got | want).sum())
    assert np.median(overlaps) > 0.8
