"""Depth moved into the view of colour."""

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from common.geometry.transforms import transform_from
from people4d.messages import CameraInfo
from services.camera.calibration import Intrinsics, camera_info
from services.camera.folder.registration import Registration

IDENTITY = np.eye(4)


def info(
    width: int = 64, height: int = 48, fx: float = 60.0, k: tuple[float, ...] = ()
) -> CameraInfo:
    intrinsics = Intrinsics(fx=fx, fy=fx, cx=width / 2, cy=height / 2, distortion=k)
    return camera_info(intrinsics, (height, width))


def plane(value: int, shape: tuple[int, int] = (48, 64)) -> npt.NDArray[np.uint16]:
    return np.full(shape, value, np.uint16)


def test_plane_moves_by_the_baseline() -> None:
    # The depth camera sits 5 cm right of colour: x_colour = x_depth + 0.05 m. At 2 m and
    # fx = 80 px that is 80 * 0.05 / 2 = 2 px to the right, so the first two columns are empty.
    register = Registration(info(fx=80), info(fx=80), transform_from((0.05, 0, 0), np.eye(3)))
    moved = register(plane(2000))
    assert (moved[:, :2] == 0).all()
    assert (moved[:, 2:] == 2000).all()


def test_depth_is_measured_along_the_axis_of_colour() -> None:
    register = Registration(info(), info(), transform_from((0, 0, 0.1), np.eye(3)))
    moved = register(plane(2000))
    assert set(np.unique(moved)) <= {0, 2100}
    assert moved[24, 32] == 2100


def test_identity_changes_nothing() -> None:
    depth = np.random.default_rng(1).integers(0, 5000, (48, 64)).astype(np.uint16)
    assert np.array_equal(Registration(info(), info(), IDENTITY)(depth), depth)


def test_nearer_surface_wins() -> None:
    # At 1 m the shift is 60 * 0.1 / 1 = 6 px, at 3 m 2 px: pixel u = 20 at 1 m maps to 26, as does
    # u = 24 at 3 m.
    depth = plane(3000)
    depth[:, 20] = 1000
    moved = Registration(info(), info(), transform_from((0.1, 0, 0), np.eye(3)))(depth)
    assert (moved[:, 26] == 1000).all()
    assert (moved[:, 22] == 0).all()  # u = 20 would map here at the depth of the wall


def test_larger_colour_image_has_no_gaps() -> None:
    colour = info(width=128, height=96, fx=120.0)
    moved = Registration(info(), colour, IDENTITY)(plane(1500))
    assert (moved[:94, :126] == 1500).all()
    # A surface grows over its edge by no more than the gap.
    depth = plane(0)
    depth[10:20, 10:20] = 1500
    v, u = np.nonzero(Registration(info(), colour, IDENTITY)(depth))
    assert (v.min(), v.max(), u.min(), u.max()) == (20, 38, 20, 38)


def test_lens_distortion_is_that_of_opencv() -> None:
    # Colour ten times as fine as depth, so that the sixth coefficient shows in the corners.
    k = (0.1, -0.05, 0.002, -0.003, 0.01, 0.2, 0.1, 0.3)
    v, u = np.mgrid[3:48:9, 2:64:9].reshape(2, -1)
    depth = plane(0)
    depth[v, u] = 2000
    rays = np.column_stack([(u - 32) / 60, (v - 24) / 60, np.ones(len(u))])
    matrix = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])
    for coefficients in (k[:4], k[:5], k):
        register = Registration(info(), info(640, 480, 600.0, coefficients), IDENTITY)
        pixels, _ = cv2.projectPoints(
            rays, np.zeros(3), np.zeros(3), matrix, np.array(coefficients)
        )
        expected = {(y, x) for x, y in np.rint(pixels[:, 0]).astype(int).tolist()}
        inside = {(y, x) for y, x in expected if 0 <= y < 480 and 0 <= x < 640}
        assert {(y, x) for y, x in np.argwhere(register(depth)).tolist()} == inside


def test_distorted_depth_and_colour_of_one_lens_change_nothing() -> None:
    intrinsics = info(k=(0.05, -0.02, 0.001, 0.001, 0.0))
    assert (Registration(intrinsics, intrinsics, IDENTITY)(plane(1234)) == 1234).all()


def test_pixel_offset() -> None:
    moved = Registration(info(), info(), IDENTITY, (3, 2))(plane(1000))
    assert (moved[2:, 3:] == 1000).all()
    assert not moved[:2].any()
    assert not moved[:, :3].any()


def test_nothing_behind_colour_and_nothing_beyond_16_bits() -> None:
    behind = Registration(info(), info(), transform_from((0, 0, -2), np.eye(3)))
    assert not behind(plane(1999)).any()
    beyond = Registration(info(), info(), transform_from((0, 0, 2), np.eye(3)))
    assert not beyond(plane(64_000)).any()


def test_empty_image_and_wrong_size() -> None:
    register = Registration(info(), info(), IDENTITY)
    assert not register(plane(0)).any()
    with pytest.raises(ValueError, match=r"expected shape \(48, 64\), got \(2, 2\)"):
        register(plane(1, (2, 2)))
