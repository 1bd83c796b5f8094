"""Visibility of people in a camera, computed by hand."""

import msgspec
import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL, invert, transform_from
from common.metrics.field_of_view import in_view
from tests import builders

# f = 100 px, 200 x 100 px, axis in the middle: 45 degrees to either side, 26.6 up and down.
INFO = builders.camera_info(width=200, height=100, fx=100.0, cx=99.5, cy=49.5, max_depth_m=5.0)
# The camera stands 1 m above the origin and looks along +x.
MAP_FROM_CAMERA = transform_from([0, 0, 1.0], np.eye(3)) @ LINK_FROM_OPTICAL


@pytest.mark.parametrize(
    ("point", "inside"),
    [
        ([2.0, 0.0, 1.0], True),
        ([5.0, 0.0, 1.0], True),  # at the end of the depth range
        ([5.01, 0.0, 1.0], False),
        ([-2.0, 0.0, 1.0], False),  # behind
        ([0.0, 0.0, 1.0], False),  # in the lens
        ([2.0, 1.98, 1.0], True),  # u = 99.5 - 100 * 1.98 / 2 = 0.5
        ([2.0, 2.0, 1.0], False),  # u = -0.5
        ([2.0, 0.0, 1.98], True),  # v = 49.5 - 49 = 0.5
        ([2.0, 0.0, 2.0], False),
    ],
)
def test_image_and_depth_range(point: list[float], inside: bool) -> None:
    got = in_view(np.array([point]), invert(MAP_FROM_CAMERA), INFO)
    assert got.tolist() == [inside]


def test_a_lens_does_not_bend_the_far_side_into_the_image() -> None:
    # u' = x (1 - 0.3 r^2): at x = 1.7 that is 1.7 (1 - 0.867) = 0.23, in the middle of the image.
    barrel = msgspec.structs.replace(
        INFO, distortion_model="plumb_bob", distortion=(-0.3, 0.0, 0.0, 0.0)
    )
    points = np.array([[2.0, -3.4, 1.0], [2.0, -0.8, 1.0]])
    assert in_view(points, invert(MAP_FROM_CAMERA), barrel).tolist() == [False, True]


def test_no_people_and_absurd_lenses() -> None:
    assert in_view(np.zeros((0, 3)), np.eye(4), INFO).tolist() == []
    absurd = msgspec.structs.replace(INFO, fx=1e5, fy=1.0, max_depth_m=1e3)
    assert in_view(np.array([[1e5, 1e5, 1.0]]), np.eye(4), absurd).shape == (1,)
