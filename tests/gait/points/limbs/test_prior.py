"""Expected positions of hands and feet relative to a body seen from the side."""

import numpy as np
import pytest

from people4d.messages import CameraInfo
from services.gait.points.keypoints import joint_pixels
from services.gait.points.normal import Normal

INFO = CameraInfo(
    stamp_ns=0,
    sequence=0,
    camera="none",
    frame_id="none",
    width=640,
    height=480,
    fx=600.0,
    fy=600.0,
    cx=320.0,
    cy=240.0,
)


def test_product_of_equal_distributions_is_half_as_wide() -> None:
    # Means 0 and 1 m with the same variance: the mean is halfway, the variance is halved.
    one = Normal(np.zeros(3), np.eye(3))
    both = one.fused(Normal(np.array([1.0, 0.0, 0.0]), np.eye(3)))
    assert both.mean_m == pytest.approx([0.5, 0.0, 0.0])
    assert both.covariance == pytest.approx(0.5 * np.eye(3))


def test_pixel_gives_the_depth_of_an_oblique_distribution() -> None:
    # A limb swings along a line at 45 degrees to the ray: 0.1 m aside in the image is 0.1 m deeper.
    axis = np.array([1.0, 0.0, 1.0]) / np.sqrt(2)
    swinging = Normal(np.array([0.0, 0.0, 3.0]), np.outer(axis, axis) + 1e-6 * np.eye(3))
    there = swinging.at_pixel(np.array([340.0, 240.0]), 0.1, INFO)
    # The ray through 20 px meets x = z - 3 at x = z / 30: z = 3.1034.
    assert there.mean_m == pytest.approx([0.1034, 0.0, 3.1034], abs=0.005)
    assert np.sqrt(there.covariance[2, 2]) < 0.01


def test_pixel_at_the_mean_changes_nothing_but_the_width() -> None:
    one = Normal(np.array([0.3, -0.2, 2.5]), 0.04 * np.eye(3))
    pixel = 600 * one.mean_m[:2] / one.mean_m[2] + (320.0, 240.0)
    there = one.at_pixel(pixel, 6.0, INFO)
    assert there.mean_m == pytest.approx(one.mean_m, abs=1e-9)
    assert one.pixel_distance2(pixel, 6.0, INFO) == pytest.approx(0.0, abs=1e-9)
    ray = one.mean_m / np.linalg.norm(one.mean_m)
    # Along the ray the pixel adds no information: sigma remains 0.2 m.
    assert ray @ there.covariance @ ray == pytest.approx(0.04)


def test_joints_of_low_confidence_are_left_out() -> None:
    keypoints = np.zeros((17, 3), np.float32)
    keypoints[7] = (100.0, 200.0, 0.9)  # left elbow
    keypoints[8] = (np.nan, 200.0, 0.9)
    assert list(joint_pixels(keypoints)) == ["left_hand"]
    assert joint_pixels(None) == {}
