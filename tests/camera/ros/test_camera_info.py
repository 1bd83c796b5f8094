"""CameraInfo as written by drivers."""

import dataclasses
from typing import Any

import pytest

from people4d.errors import SourceError
from services.camera.ros.camera_info import intrinsics_of, same_numbers
from tests.camera.ros.bags import SIZE, Ros

ROS = Ros(2)
RAW, RECT = "/camera/color/image_raw", "/kinect2/qhd/image_color_rect/compressed"


def camera_info(model: str = "plumb_bob", *distortion: float, **changes: Any) -> Any:
    return dataclasses.replace(ROS.camera_info(10.0, distortion, model), **changes)


def roi(x: int, y: int, width: int, height: int) -> Any:
    fields = {"x_offset": x, "y_offset": y, "width": width, "height": height}
    return ROS.make("sensor_msgs/msg/RegionOfInterest", **fields)


def test_binning_divides_the_calibration_of_the_full_sensor() -> None:
    # The sensor has 16x12 pixels, fx 20 and cx 8; images have 8x6: fx 10 and cx 4.
    sensor = camera_info(width=16, height=12, binning_x=2, binning_y=2)
    sensor = dataclasses.replace(sensor, k=sensor.k * [2, 1, 2, 1, 2, 2, 1, 1, 1])
    found = intrinsics_of(sensor)
    assert (found.width, found.height) == (8, 6)
    assert (found.fx, found.fy, found.cx, found.cy) == (10, 10, 4, 3)


def test_offset_of_the_region_of_interest_is_subtracted_before_binning() -> None:
    # cx 4 of the sensor is 4 - 2 = 2 in the region, 1 in images of half its size.
    found = intrinsics_of(camera_info(roi=roi(2, 1, 4, 4), binning_x=2, binning_y=2))
    assert (found.width, found.height, found.cx, found.cy) == (2, 2, 1.0, 1.0)
    full = intrinsics_of(camera_info(roi=roi(0, 0, 8, 6)))
    assert (full.width, full.height, full.cx, full.cy) == (8, 6, 4.0, 3.0)


@pytest.mark.parametrize(
    ("model", "given", "read"),
    [
        ("plumb_bob", (0.1, 0.2, 0, 0, 0.3, 0, 0, 0), (0.1, 0.2, 0, 0, 0.3)),  # Orbbec
        ("plumb_bob", (0.1, 0, 0, 0, 0, 0, 0, 0.4), (0.1, 0, 0, 0, 0, 0, 0, 0.4)),
        ("plumb_bob", (0.1, 0.2, 0, 0), (0.1, 0.2, 0, 0, 0)),
        ("rational_polynomial", (0.1, 0, 0, 0, 0), (0.1, 0, 0, 0, 0)),
        ("rational_polynomial", (0, 0, 0, 0, 0, 0, 0.2, 0, 0, 0, 0, 0), (0,) * 6 + (0.2, 0)),
        ("Brown Conrady", (0.1, 0, 0, 0, 0), (0.1, 0, 0, 0, 0)),
        ("Inverse Brown Conrady", (0, 0, 0, 0, 0), ()),
        ("", (0.1,), (0.1, 0, 0, 0, 0)),
    ],
)
def test_distortion_is_read_by_its_coefficients(
    model: str, given: tuple[float, ...], read: tuple[float, ...]
) -> None:
    assert intrinsics_of(camera_info(model, *given)).distortion == read


@pytest.mark.parametrize("model", ["Kannala Brandt4", "Ftheta", "none"])
def test_lens_that_is_no_pinhole_is_refused_unless_rectified(model: str) -> None:
    info = camera_info(model, 0.1, 0.0, 0.0, 0.0)
    with pytest.raises(SourceError, match=f"got 1 numbers for '{model}'.*rectified"):
        intrinsics_of(info, RAW)
    assert intrinsics_of(info, RECT).distortion == ()


def test_lens_without_coefficients_that_is_no_pinhole_is_refused() -> None:
    with pytest.raises(SourceError, match="ftheta"):
        intrinsics_of(camera_info("ftheta"))


def test_fisheye_lens_has_four_coefficients_unless_rectified() -> None:
    info = camera_info("equidistant", 0.1, 0.0, -0.2)
    raw, rectified = intrinsics_of(info, RAW), intrinsics_of(info, RECT)
    assert (raw.fisheye, raw.distortion) == (True, (0.1, 0.0, -0.2, 0.0))
    assert (rectified.fisheye, rectified.distortion) == (False, ())


def test_thin_prism_coefficients_are_refused() -> None:
    with pytest.raises(SourceError, match="12 numbers"):
        intrinsics_of(camera_info("rational_polynomial", *[0.1] * 12))


@pytest.mark.parametrize("topic", [RECT, "/zed/rgb/color/rect/image", "/a/image_rect_color"])
def test_rectified_images_have_the_projection_without_distortion(topic: str) -> None:
    info = camera_info("plumb_bob", 0.1)
    p = [9.0, 0, 4.5, 0, 0, 9, 3.5, 0, 0, 0, 1, 0]
    info = dataclasses.replace(info, p=info.p + p)
    found = intrinsics_of(info, topic)
    assert (found.fx, found.cx, found.cy, found.distortion) == (9, 4.5, 3.5, ())
    assert intrinsics_of(info, "/camera/direct/image").fx == 10


@pytest.mark.parametrize("change", [{"binning_x": 2}, {"roi": roi(1, 0, 0, 0)}, {"width": 9}])
def test_change_of_binning_or_region_is_another_calibration(change: dict[str, Any]) -> None:
    assert same_numbers(camera_info(), camera_info(header=ROS.header(5)))
    assert not same_numbers(camera_info(), camera_info(**change))
    assert camera_info().height == SIZE[0]
