"""Frames, the pinhole camera and angles (docs/method.md section 1)."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from common.geometry.transforms import (
    LINK_FROM_OPTICAL,
    apply,
    camera_matrix,
    deproject,
    invert,
    project,
    rotation_from_rpy,
    transform_from,
    wrap,
)
from tests import builders

INFO = builders.camera_info(camera="c", frame_id="c_optical_frame", fx=500.0, fy=400.0)
LENSES = {
    "webcam": ("plumb_bob", (0.1, -0.25, 0.001, -0.0005)),
    "kinect": ("plumb_bob", (0.26, -0.92, -0.003, 0.003, 1.15)),
    "wide": ("plumb_bob", (-0.3, 0.1, 0.001, -0.0005, 0.0)),
    "azure": ("rational_polynomial", (0.5, -2.6, 0.0005, -0.0002, 1.5, 0.4, -2.4, 1.4)),
}
ANGLES = st.floats(-100, 100)


def test_deproject_by_hand() -> None:
    # X = (420 - 320) 2 / 500 = 0.4, Y = (200 - 240) 2 / 400 = -0.2; the centre is on the axis.
    points = deproject([[420, 200], [320, 240]], [2.0, 3.0], INFO)
    np.testing.assert_allclose(points, [[0.4, -0.2, 2.0], [0.0, 0.0, 3.0]])


def test_project_by_hand() -> None:
    # u = 500 * 1 / 2 + 320 = 570, v = 400 * 0.5 / 2 + 240 = 340.
    np.testing.assert_allclose(project([[1.0, 0.5, 2.0]], INFO), [[570.0, 340.0]])


def test_distortion_by_hand() -> None:
    # x = 0.4, y = 0, r2 = 0.16; k1 = 0.5: x (1 + 0.5 * 0.16) = 0.432; u = 500 * 0.432 + 320 = 536.
    bent = msgspec.structs.replace(
        INFO, distortion_model="plumb_bob", distortion=(0.5, 0.0, 0.0, 0.0)
    )
    np.testing.assert_allclose(project([[0.8, 0.0, 2.0]], bent), [[536.0, 240.0]])
    np.testing.assert_allclose(deproject([[536.0, 240.0]], [2.0], bent), [[0.8, 0, 2]], atol=1e-8)


@pytest.mark.parametrize("lens", LENSES)
def test_deproject_undoes_project_over_the_full_image(lens: str) -> None:
    # OpenCV's usual five iterations leave 0.07 px at the corner of the wide lens.
    model, coefficients = LENSES[lens]
    info = msgspec.structs.replace(
        INFO, fx=520.0, fy=520.0, distortion_model=model, distortion=coefficients
    )
    pixels = np.stack(np.meshgrid(np.arange(0, 640, 32), np.arange(0, 480, 32)), -1).reshape(-1, 2)
    depth_m = np.linspace(0.5, 5.0, len(pixels))
    points = deproject(pixels, depth_m, info)
    np.testing.assert_array_equal(points[:, 2], depth_m)
    np.testing.assert_allclose(project(points, info), pixels, atol=1e-6)


@pytest.mark.parametrize("distortion", [(), (0.1, 0.0, 0.0, 0.0)])
def test_no_points_give_no_points(distortion: tuple[float, ...]) -> None:
    model = "plumb_bob" if distortion else "none"
    info = msgspec.structs.replace(INFO, distortion_model=model, distortion=distortion)
    assert deproject(np.zeros((0, 2)), [], info).shape == (0, 3)
    assert project(np.zeros((0, 3)), info).shape == (0, 2)


def test_camera_matrix_by_hand() -> None:
    np.testing.assert_array_equal(camera_matrix(INFO), [[500, 0, 320], [0, 400, 240], [0, 0, 1]])


def test_axes_of_link_and_optical_frame() -> None:
    # Optical: x right, y down, z forward. Link: x forward, y left, z up.
    right, down, forward = np.eye(3)
    np.testing.assert_array_equal(apply(LINK_FROM_OPTICAL, right), [0, -1, 0])
    np.testing.assert_array_equal(apply(LINK_FROM_OPTICAL, down), [0, 0, -1])
    np.testing.assert_array_equal(apply(LINK_FROM_OPTICAL, forward), [1, 0, 0])


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0.0, 0.0),
        (math.pi, math.pi),
        (-math.pi, math.pi),
        (3 * math.pi / 2, -math.pi / 2),
        (-3 * math.pi / 2, math.pi / 2),
        (4 * math.pi + 0.5, 0.5),
    ],
)
def test_wrap_by_hand(angle: float, wrapped: float) -> None:
    assert wrap(angle) == pytest.approx(wrapped)


@settings(deadline=None)
@given(st.floats(-1e6, 1e6))
def test_wrap_adds_full_turns(angle: float) -> None:
    wrapped = wrap(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-6)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-6)


def test_wrap_just_beyond_pi_stays_inside_the_interval() -> None:
    # The remainder of -4e-16 by 2 pi rounds up to 2 pi, which must not give -pi: that is outside.
    assert -math.pi < wrap(math.nextafter(math.pi, 4.0)) <= math.pi


@settings(deadline=None)
@given(ANGLES, ANGLES, ANGLES)
def test_rpy_agrees_with_scipy(roll: float, pitch: float, yaw: float) -> None:
    expected = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()  # fixed axes
    np.testing.assert_allclose(rotation_from_rpy(roll, pitch, yaw), expected, atol=1e-12)


def test_yaw_turns_forward_to_the_left() -> None:
    np.testing.assert_allclose(
        rotation_from_rpy(0, 0, math.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15
    )


def test_apply_and_invert_undo_each_other() -> None:
    target_from_source = transform_from([1.0, -2.0, 3.0], rotation_from_rpy(0.1, -0.7, 2.0))
    points = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [-4.0, 0.5, 9.0]])
    moved = apply(target_from_source, points)
    np.testing.assert_allclose(moved[0], [1.0, -2.0, 3.0])
    np.testing.assert_allclose(apply(invert(target_from_source), moved), points, atol=1e-12)
    np.testing.assert_allclose(apply(target_from_source, points[1]), moved[1])
    np.testing.assert_allclose(
        invert(target_from_source) @ target_from_source, np.eye(4), atol=1e-12
    )
