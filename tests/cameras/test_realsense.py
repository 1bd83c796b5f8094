"""The plug-in of RealSense with its SDK: frames of a device in software, and of a recording."""

from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cameras.realsense import RealSense, RealSenseDevice
from people4d.errors import People4dError
from services.camera.source import SourceFrame, SourceSetup
from tests.cameras.soft_realsense import (
    CX,
    CY,
    FIRST_MS,
    FX,
    HEIGHT,
    PERIOD_MS,
    SERIAL,
    WIDTH,
    SoftRealSense,
    import_sdk,
)

COUNT = 10
OPTIONS = {"width": WIDTH, "height": HEIGHT, "fps": 10}


class Recorded(RealSense):
    """A RealSense whose only device plays a recording."""

    shared: Any
    playback: Any  # keeps the device in the context

    @classmethod
    def context(cls) -> Any:
        return cls.shared


@pytest.fixture
def rs() -> Any:
    return import_sdk()


@pytest.fixture
def recording(rs: Any, tmp_path: Path) -> Path:
    """Write a recording with the SDK's recorder."""
    path = tmp_path / "soft.db3"
    device = SoftRealSense(rs, path)
    for number in range(COUNT):
        device.send(number, 2000 + number, rs.timestamp_domain.system_time)
        device.frames.try_wait_for_frames(1000)
        device.frames.try_wait_for_frames(50)  # a repeated frame: the period of the recording
    device.stop()
    return path


def test_pairs_have_millimetres_calibration_and_time_of_the_camera(rs: Any) -> None:
    device = SoftRealSense(rs)
    camera = RealSenseDevice(rs, device.frames, device.colour)
    frame = None
    for number in range(5):  # the first frames of both streams may have different times
        device.send(number, 3000, rs.timestamp_domain.global_time)
        frame = frame or camera.read()
    device.stop()
    assert isinstance(frame, SourceFrame)
    # 3000 units of 0.5 mm
    assert set(frame.depth_mm.ravel().tolist()) - {0} == {1500}
    assert np.count_nonzero(frame.depth_mm) > 0.9 * HEIGHT * WIDTH
    assert (frame.rgb == (3000 % 256, 2, 3)).all()
    late_ms = frame.stamp_ns / 1e6 - FIRST_MS
    assert late_ms % PERIOD_MS == pytest.approx(0, abs=0.01)
    info = camera.info
    assert (info.width, info.height) == (WIDTH, HEIGHT)
    assert (info.fx, info.fy, info.cx, info.cy) == (FX, FX, CX, CY)
    assert info.distortion == pytest.approx((0.1, -0.2, 0.01, 0.0, 0.05))


def test_clock_of_the_camera_is_replaced_by_the_time_of_arrival(
    rs: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = SoftRealSense(rs)
    camera = RealSenseDevice(rs, device.frames, device.colour)
    monkeypatch.setattr("cameras.realsense.time.time_ns", lambda: 5)
    frame = None
    for number in range(5):
        device.send(number, 3000, rs.timestamp_domain.hardware_clock)
        frame = frame or camera.read()
    device.stop()
    assert frame
    assert frame.stamp_ns == 5


def test_recording_plays_as_a_camera_and_its_end_is_unplugging(rs: Any, recording: Path) -> None:
    Recorded.shared = rs.context()
    Recorded.playback = Recorded.shared.load_device(str(recording))
    assert Recorded.list_devices() == [("RealSense in software", SERIAL)]
    camera, items = Recorded(serial=SERIAL, **OPTIONS), list[Any]()
    with pytest.raises(People4dError, match=r"camera realsense sends no images for 1 s"):
        items.extend(camera)
    setup, *frames = items
    assert isinstance(setup, SourceSetup)
    assert setup.info.fx == FX
    # Some may be dropped or repeated on a loaded machine; each keeps its depth and stamp.
    numbers = [int(frame.rgb[0, 0, 0]) - 2000 % 256 for frame in frames]
    assert numbers == sorted(numbers)
    assert numbers[-1] == COUNT - 1
    for number, frame in zip(numbers, frames, strict=True):
        assert frame.depth_mm.max() == pytest.approx((2000 + number) / 2, abs=1)
        assert frame.stamp_ns == pytest.approx((FIRST_MS + number * PERIOD_MS) * 1e6, abs=1e3)


def test_unknown_serial_and_unknown_mode_are_errors_with_a_remedy(rs: Any, recording: Path) -> None:
    Recorded.shared = rs.context()
    Recorded.playback = Recorded.shared.load_device(str(recording))
    with pytest.raises(People4dError, match=rf"no camera realsense has serial 7, but {SERIAL}"):
        list(islice(Recorded(serial="7", **OPTIONS), 1))
    with pytest.raises(People4dError, match=r"resolve.*Choose options.width, height and fps"):
        list(islice(Recorded(**OPTIONS | {"width": 4000}), 1))


def test_absent_camera_is_an_error_with_a_remedy(rs: Any) -> None:
    with pytest.raises(People4dError, match=r"no camera realsense is plugged in\. See: people4d"):
        next(iter(RealSense()))
