"""Positions and colours of drawn people, and unchanged pixels."""

import numpy as np
import numpy.typing as npt
import pytest

from common.drawing.people import CameraView, annotate
from common.drawing.strokes import INK, PAPER, PEOPLE, WHITE, colour_of, ink_on
from common.drawing.tiles import Tile, shrink
from common.drawing.topdown import Trajectories, draw_map
from common.geometry.transforms import invert
from common.runtime.synchroniser import SynchronisedFrame
from people4d.messages import U8
from services.report.sheet import contact_sheet
from services.report.statistics import RunStatistics
from tests.report.builders import (
    MAP_FROM_OPTICAL,
    detection,
    detections,
    frame,
    info,
    span,
    track,
    tracks,
)

VIEW = CameraView(info(), invert(MAP_FROM_OPTICAL))


def near(image: U8, colour: tuple[int, int, int]) -> npt.NDArray[np.bool_]:
    """Mask of the pixels near a colour."""
    alike: npt.NDArray[np.bool_] = np.all(np.abs(image.astype(int) - colour) <= 6, axis=2)
    return alike


def test_drawing_leaves_the_frame_as_it_is() -> None:
    rgb = frame(0).rgb
    before = rgb.copy()
    image = annotate(
        rgb, detections(0, [detection()]), tracks(0, [track(1, 2.0, detection_index=0)]), VIEW
    )
    np.testing.assert_array_equal(rgb, before)
    assert image.shape == rgb.shape
    assert (image != rgb).any()


def test_nothing_to_draw_is_the_frame_itself() -> None:
    rgb = frame(0).rgb
    np.testing.assert_array_equal(annotate(rgb, detections(0), tracks(0), VIEW), rgb)
    np.testing.assert_array_equal(annotate(rgb, None, None, None), rgb)


def test_the_box_has_the_colour_of_its_track() -> None:
    image = annotate(
        frame(0).rgb,
        detections(0, [detection()]),
        tracks(0, [track(3, 2.0, detection_index=0)]),
        None,
    )
    assert near(image, colour_of(3))[110, 50]  # left edge of the box (50, 20, 100, 115)
    assert not near(image, colour_of(3))[110, 40]


def test_the_mask_is_tinted_only_inside() -> None:
    person = detection()
    image = annotate(frame(0).rgb, detections(0, [person]), None, None)
    assert (image[78, 62] != 128).any()  # in the mask (60, 40) to (80, 80), off the skeleton
    assert (image[100, 95] == 128).all()  # in the box, outside the mask


def test_a_lost_track_is_drawn_where_it_is_predicted() -> None:
    # At 2 m ahead and 1 m high, the height of the camera: the middle of the image, (80, 60).
    image = annotate(frame(0).rgb, None, tracks(0, [track(1, 2.0, state="lost")]), VIEW)
    rows, columns = np.nonzero((image != 128).any(axis=2))
    assert rows.min() < 60 < rows.max()
    assert columns.min() < 80 < columns.max()


@pytest.mark.parametrize("x_m", [-2.0, 0.0, 0.1])
def test_people_behind_the_camera_are_not_drawn(x_m: float) -> None:
    rgb = frame(0).rgb
    np.testing.assert_array_equal(annotate(rgb, None, tracks(0, [track(1, x_m)]), VIEW), rgb)


def test_boxes_far_outside_do_no_harm() -> None:
    person = detection()
    person.box_xyxy_px[:] = (-1e30, -1e6, 1e30, 1e6)
    assert person.keypoints is not None
    person.keypoints[:, 0] = 1e20
    assert annotate(frame(0).rgb, detections(0, [person]), None, None).shape == (120, 160, 3)


def test_a_track_that_names_no_detection_of_the_frame() -> None:
    stray = tracks(0, [track(1, 2.0, detection_index=5)])
    assert annotate(frame(0).rgb, detections(0, [detection()]), stray, VIEW).shape == (120, 160, 3)


def test_colours_are_stable_and_readable() -> None:
    assert colour_of(1) == colour_of(1 + len(PEOPLE))
    assert len({colour_of(k) for k in range(1, len(PEOPLE) + 1)}) == len(PEOPLE)
    assert (ink_on((250, 250, 250)), ink_on((10, 10, 10))) == (INK, WHITE)


def test_the_map_has_x_up_and_y_left() -> None:
    # From (0, 0) to (2, 0) the person walks up; the end dot is the highest point of the buffer.
    line = np.stack([np.linspace(0, 2, 20), np.zeros(20)], axis=1)
    image = draw_map(Trajectories(tracks={1: line}), 300, 300)
    rows, columns = np.nonzero(near(image, colour_of(1)))
    assert rows.max() - rows.min() > 150  # 2 m of the 3 m that 300 px show are 200 px
    aside = draw_map(Trajectories(tracks={1: line[:, ::-1]}), 300, 300)
    rows, columns = np.nonzero(near(aside, colour_of(1)))
    assert columns.max() - columns.min() > 150
    dot = rows[columns < columns.min() + 8]  # the end, y = 2, is on the left and has the dot
    assert np.ptp(dot) >= 8


@pytest.mark.parametrize(
    "walks",
    [
        Trajectories(),
        Trajectories(tracks={1: np.array([[1e9, 0.0], [1.0, 1.0]])}),
        Trajectories(truth={"a": np.zeros((1, 2))}, cameras=[np.eye(4), MAP_FROM_OPTICAL]),
    ],
)
def test_odd_maps(walks: Trajectories) -> None:
    assert draw_map(walks, 200, 100).shape == (100, 200, 3)


@pytest.mark.parametrize(("count", "rows", "columns"), [(0, 0, 0), (3, 1, 3), (4, 1, 4), (6, 2, 4)])
def test_the_sheet_holds_all_tiles(count: int, rows: int, columns: int) -> None:
    tile = Tile(np.zeros((300, 400, 3), np.uint8), "front  0.00 s")
    page = contact_sheet([tile] * count, Trajectories(), RunStatistics().summary())
    # Heights: header 60 px, panel 600 px. A tile with its gap is 408x308 px; one more gap is 8 px.
    assert page.shape == (60 + 600 + (rows * 308 + 8) * (rows > 0), max(1440, columns * 408 + 8), 3)
    dark = np.count_nonzero(page.max(axis=2) == 0)
    assert dark >= count * 300 * 400 * 0.9  # except the captions


def test_tiles_of_two_cameras_need_not_be_alike() -> None:
    tiles = [Tile(np.zeros((h, 400, 3), np.uint8), "x") for h in (300, 225)]
    page = contact_sheet(tiles, Trajectories(), RunStatistics().summary())
    assert tuple(page[60 + 8 + 225 + 4, 8 + 408 + 10]) == PAPER  # below the lower one


def test_the_page_grows_with_the_latency_table() -> None:
    statistics = RunStatistics()
    trace = tuple(span(f"service.stage{k}", k, k + 1) for k in range(60))
    statistics.settle(SynchronisedFrame("front", 0, frame(0), None, tracks(0, trace=trace)))
    summary = statistics.summary()
    assert len(summary.latency) == 61  # 60 stages, complete
    page = contact_sheet([], Trajectories(), summary)
    lowest = np.flatnonzero(page.min(axis=(1, 2)) < 100).max()  # of the dark text
    assert 660 < lowest < page.shape[0] - 8


def test_shrink_keeps_proportions() -> None:
    assert shrink(frame(0).rgb, 80).shape == (60, 80, 3)
