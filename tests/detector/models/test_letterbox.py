from collections.abc import Mapping

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.inference.session import Array
from people4d.errors import ModelError
from services.detector.models.letterbox import Letterbox
from services.detector.models.network import ImageInput
from tests.detector.array_session import ArraySession

SIDE = st.integers(1, 4000)
INPUT_SIDE = st.integers(1, 40).map(lambda n: 32 * n)


def test_camera_image_in_the_default_input() -> None:
    # 640x480 into 320x256: the width decides, 320/640 = 0.5; 480 * 0.5 = 240 rows, bars of 8.
    box = Letterbox.fit((480, 640), (256, 320))
    assert (box.height, box.width, box.top, box.left) == (240, 320, 8, 0)
    # The point (100, 60) of the image lies at (50, 30 + 8).
    np.testing.assert_allclose(box.to_image([[50.0, 38.0]]), [[100.0, 60.0]])


def test_rounded_sides_have_factors_of_their_own() -> None:
    # 3x100 into 32x32: scale 0.32, height 0.96 -> 1 pixel, so vertically 1/3 instead of 0.32.
    box = Letterbox.fit((3, 100), (32, 32))
    assert (box.height, box.width, box.top, box.left) == (1, 32, 15, 0)
    assert box.scale_y == pytest.approx(1 / 3)
    assert box.scale_x == pytest.approx(0.32)


@given(SIDE, SIDE, INPUT_SIDE, INPUT_SIDE)
def test_corners_of_the_image_are_the_corners_of_the_letterbox(
    height: int, width: int, input_height: int, input_width: int
) -> None:
    box = Letterbox.fit((height, width), (input_height, input_width))
    letterbox = [box.left, box.top, box.left + box.width, box.top + box.height]
    np.testing.assert_allclose(box.to_image(letterbox), [0, 0, width, height], atol=1e-6)
    assert min(box.top, box.left) >= 0
    assert box.top + box.height <= input_height
    assert box.left + box.width <= input_width


@pytest.mark.parametrize(
    ("image_size", "input_size"),
    [
        ((480, 640), (256, 320)),  # half, exactly
        ((853, 1281), (320, 416)),  # odd sides, made smaller
        ((479, 333), (640, 640)),  # made larger, bars left and right
        ((640, 640), (640, 640)),  # as it is
    ],
)
def test_pixels_land_where_positions_do(
    image_size: tuple[int, int], input_size: tuple[int, int]
) -> None:
    # A bright block covers [100, 180) x [200, 260): its centre is (140, 230) between the pixels.
    image = np.zeros((*image_size, 3), np.uint8)
    image[200:260, 100:180] = 255
    box = Letterbox.fit(image_size, input_size)
    moments = cv2.moments(box.fill(image, grey=0)[:, :, 0])
    # Moments count pixel indices; a pixel's centre is one half farther.
    x = moments["m10"] / moments["m00"] + 0.5
    y = moments["m01"] / moments["m00"] + 0.5
    # Half a pixel missed on either side would show as at least 0.16; sampling costs 0.05.
    np.testing.assert_allclose(box.to_image([[x, y]]), [[140.0, 230.0]], atol=0.08 / box.scale_x)


def test_bars_have_the_given_grey() -> None:
    box = Letterbox.fit((480, 640), (640, 640))
    canvas = box.fill(np.full((480, 640, 3), 7, np.uint8), grey=114)
    # 480 rows in 640: bars of 80 above and below.
    assert (canvas[:80] == 114).all()
    assert (canvas[80:560] == 7).all()
    assert (canvas[560:] == 114).all()


class BrokenSession(ArraySession):
    """A network that cannot be run."""

    def run(self, image: Array) -> Mapping[str, Array]:
        raise RuntimeError(f"no memory for {image.shape}\nat line 3")


def test_network_that_cannot_be_run_is_reported_with_the_first_line_of_the_reason() -> None:
    size = ImageInput(32, 64, True, np.dtype("float32"))
    says = r"x\.onnx: cannot be run on an image: no memory for \(1, 3, 32, 64\)$"
    with pytest.raises(ModelError, match=says):
        size.try_out(BrokenSession({}, (1, 3, 32, 64)), "x.onnx")
