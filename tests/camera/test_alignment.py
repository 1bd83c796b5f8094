"""Images of a fisheye lens are published as images of a pinhole."""

import cv2
import numpy as np
import pytest

from common.geometry.transforms import deproject, project
from people4d.errors import SourceError
from people4d.messages import F64
from services.camera.alignment import align
from services.camera.calibration import Calibration, Intrinsics
from services.camera.distortion import read_distortion

WIDTH, HEIGHT = 320, 240
COEFFICIENTS = (-0.02, 0.01, -0.004, 0.001)
LENS = Intrinsics(fx=130.0, fy=130.0, cx=158.0, cy=121.0, distortion=COEFFICIENTS, fisheye=True)
POINTS_M: F64 = np.array([[0.3, 0.2, 1.5], [-0.9, 0.1, 2.0], [0.0, -0.4, 1.0], [1.0, 0.5, 2.5]])


def distorted(points_m: F64) -> F64:
    """Return the pixels (Nx2) of points by the equations of the lens."""
    x, y, z = points_m.T
    radius = np.hypot(x, y)
    angle = np.arctan2(radius, z)
    powers = angle[:, None] ** np.array([3, 5, 7, 9])
    reach = (angle + powers @ np.array(COEFFICIENTS)) / radius
    return np.column_stack([LENS.fx * reach * x + LENS.cx, LENS.fy * reach * y + LENS.cy])


def test_points_of_a_fisheye_image_are_at_their_pixels_and_depths_in_the_pinhole() -> None:
    alignment = align(Calibration(colour=LENS), LENS, (HEIGHT, WIDTH), (HEIGHT, WIDTH))
    assert alignment.info.distortion == ()
    for point_m, pixel in zip(POINTS_M, distorted(POINTS_M), strict=True):
        rgb = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        depth_mm = np.full((HEIGHT, WIDTH), 4000, np.uint16)
        centre = tuple(int(n) for n in np.rint(pixel))
        cv2.circle(rgb, centre, 5, (255, 255, 255), -1)
        cv2.circle(depth_mm, centre, 5, round(1000 * point_m[2]), -1)
        pinhole, pinhole_mm = alignment(rgb, depth_mm)
        rows, columns = np.nonzero(pinhole_mm == round(1000 * point_m[2]))
        middle = np.array([[columns.mean(), rows.mean()]])
        expected = project(point_m[None], alignment.info)
        np.testing.assert_allclose(middle, expected, atol=1.0)
        np.testing.assert_allclose(
            deproject(middle, [point_m[2]], alignment.info)[0], point_m, atol=0.02
        )
        assert pinhole[round(expected[0, 1]), round(expected[0, 0])].min() > 200
        assert set(np.unique(pinhole_mm)) <= {0, 4000, round(1000 * point_m[2])}  # nothing is mixed


@pytest.mark.parametrize("model", ["equidistant", "fisheye", "Equidistant"])
def test_names_of_fisheye_lenses_are_read(model: str) -> None:
    assert read_distortion(model, COEFFICIENTS) == COEFFICIENTS
    assert read_distortion(model, (0.1, 0.0)) == (0.1, 0.0, 0.0, 0.0)
    with pytest.raises(SourceError, match="equidistant"):
        read_distortion(model, (*COEFFICIENTS, 0.1))


def test_fisheye_lens_of_depth_alone_is_refused() -> None:
    pinhole = Intrinsics(fx=130.0, fy=130.0, cx=158.0, cy=121.0)
    calibration = Calibration(colour=pinhole, depth=LENS)
    with pytest.raises(SourceError, match="depth has a fisheye lens"):
        align(calibration, pinhole, (HEIGHT, WIDTH), (HEIGHT, WIDTH))


def test_impossible_coefficients_are_refused() -> None:
    with pytest.raises(ValueError, match="expected 4 coefficients"):
        Intrinsics(fx=130.0, fy=130.0, cx=158.0, cy=121.0, distortion=(0.1,) * 5, fisheye=True)
    broken = Intrinsics(
        fx=130.0, fy=130.0, cx=158.0, cy=121.0, distortion=(float("nan"),) * 4, fisheye=True
    )
    with pytest.raises(SourceError, match="give no image"):
        align(Calibration(colour=broken), broken, (HEIGHT, WIDTH), (HEIGHT, WIDTH))
