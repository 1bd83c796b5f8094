"""Images of a scenario."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from common.drawing.strokes import PEOPLE
from lab.camera.frames import FrameRenderer, RenderSettings
from lab.catalogue import load_scenario
from lab.output.preview import Preview, depth_image, write_sheet, write_video
from lab.world import World
from people4d.errors import SourceError
from tests.lab.scenarios import FRAMES, SIZE, write_scenario

pytestmark = pytest.mark.render

HEIGHT, WIDTH = SIZE


@pytest.fixture
def preview(tmp_path: Path) -> Preview:
    world = World(load_scenario(str(write_scenario(tmp_path))))
    return Preview(FrameRenderer(world, RenderSettings(colour="flat")))


def test_depth_goes_from_red_to_blue_and_is_black_without_a_reading() -> None:
    near, middle, far, none = depth_image(np.array([[600, 2500, 4800, 0]], np.uint16), 5.0)[0]
    assert near[0] > 2 * near[2]
    assert far[2] > 2 * far[0]
    assert middle[1] > max(middle[0], middle[2])
    assert none.tolist() == [0, 0, 0]


def test_image_shows_truth_depth_masks_and_a_map(preview: Preview) -> None:
    image = preview.image(6)
    assert image.shape == (2 * HEIGHT, 2 * WIDTH, 3) == (*preview.size[::-1], 3)
    truth, masks = image[:HEIGHT, :WIDTH], image[HEIGHT:, :WIDTH]
    # The boxes are drawn in the colours of the two people, where the masks have none.
    for colour in PEOPLE[:2]:
        assert (truth == colour).all(axis=2).sum() > 20
    assert not (masks == PEOPLE[0]).all(axis=2).any()  # there people are shaded
    blue = (masks[..., 2].astype(int) - masks[..., 0]) > 60
    assert blue.sum() > 50
    assert (image[HEIGHT:, WIDTH:] > 240).all(axis=2).mean() > 0.5  # paper of the map


def test_frames_of_a_video_and_of_a_page(preview: Preview) -> None:
    assert list(preview.frames()) == list(range(FRAMES))
    assert list(preview.frames(0.5)) == [0, 5, 10]  # at 10 Hz
    few = preview.few_frames()
    assert len(few) == 9
    assert 0 < few[0] < few[-1] < FRAMES - 1
    assert preview.few_frames(0.5) == preview.frames(0.5)


def test_a_page(preview: Preview, tmp_path: Path) -> None:
    shares: list[float] = []
    write_sheet(preview, [0, 4, 8, 11], tmp_path / "page.png", shares.append)
    assert shares == [0.25, 0.5, 0.75, 1.0]
    page = cv2.imread(str(tmp_path / "page.png"))
    # Tiles are 640 wide and 480 high (two by two of 80x60), with 8 pixels between; 3 in a row.
    assert page is not None
    assert page.shape == (2 * 488 + 8, 3 * 648 + 8, 3)
    with pytest.raises(SourceError, match="cannot be written"):
        write_sheet(preview, [0], tmp_path / "none" / "page.png", shares.append)


def test_a_video(preview: Preview, tmp_path: Path) -> None:
    write_video(preview, preview.frames(0.2), tmp_path / "walk.webm", lambda _: None)
    video = cv2.VideoCapture(str(tmp_path / "walk.webm"))
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(5.0)
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 6
    read, image = video.read()
    assert read
    assert image.shape == (2 * HEIGHT, 2 * WIDTH, 3)
