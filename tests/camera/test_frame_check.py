"""Frames of another type, size, unit or stamp than declared, as plug-in cameras give them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from services.camera.frame_check import FrameCheck, frame_fault
from services.camera.source import SourceFrame, SourceSetup
from tests.camera.memory import SIZE, MemorySource, capture

GOOD = capture(0)
INFO = MemorySource([]).info


def wrong(**fields: Any) -> SourceFrame:
    return replace(GOOD, **fields)


@pytest.mark.parametrize(
    ("frame", "counter", "fault"),
    [
        (
            wrong(depth_mm=np.ones(SIZE, np.float32)),
            "wrong_type",
            "depth_mm is float32 (6, 8), expected uint16 (6, 8) millimetres",
        ),
        (wrong(depth_mm=None), "wrong_type", "depth_mm is NoneType, expected an array of numpy"),
        (
            wrong(depth_mm=np.full(SIZE, 3, np.uint16)),
            "wrong_unit",
            "depth_mm is 3 at most: metres, expected millimetres",
        ),
        (
            wrong(rgb=np.zeros((*SIZE, 4), np.uint8)),
            "wrong_size",
            "rgb is uint8 (6, 8, 4), expected uint8 (6, 8, 3) red first",
        ),
        (wrong(stamp_ns=1.5), "wrong_stamp", "stamp_ns is float, expected int nanoseconds"),
        (wrong(stamp_ns=None), "wrong_stamp", "stamp_ns is NoneType, expected int nanoseconds"),
        ((GOOD.rgb, GOOD.depth_mm), "wrong_type", "it yields tuple, expected SourceFrame"),
        (wrong(depth_mm=np.full(SIZE, 0, np.uint16)), "", ""),
        (wrong(depth_mm=np.full(SIZE, 50, np.uint16)), "", ""),
        (wrong(depth_mm=np.full(SIZE, 5000, np.uint16)), "", ""),
    ],
)
def test_difference_of_a_frame_is_named(frame: object, counter: str, fault: str) -> None:
    assert frame_fault(frame, INFO) == (counter, fault)


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
def test_declared_metres_become_millimetres(kind: type[np.floating]) -> None:
    depth_m = np.full(SIZE, 2.5, kind)
    depth_m[0, :5] = np.nan, np.inf, -1.0, 65.75, 0.0
    used = FrameCheck(INFO, in_metres=True).accept(wrong(depth_mm=depth_m))
    assert isinstance(used, SourceFrame)
    assert used.depth_mm.dtype == np.uint16
    assert used.depth_mm[0].tolist() == [0, 0, 0, 0, 0, 2500, 2500, 2500]
    assert (used.depth_mm[1:] == 2500).all()


@pytest.mark.parametrize(
    ("depth", "counter", "fault"),
    [
        (
            np.full(SIZE, 2500, np.uint16),
            "wrong_type",
            "depth_mm is uint16 (6, 8), expected float (6, 8) metres",
        ),
        (
            np.full(SIZE, 2500.0, np.float32),
            "wrong_unit",
            "depth is 2500 at least: millimetres, declared as metres",
        ),
        (None, "wrong_type", "depth_mm is NoneType, expected an array of numpy"),
        (np.zeros(SIZE), "", ""),
        (np.full(SIZE, np.nan), "", ""),
    ],
)
def test_difference_from_declared_metres_is_named(depth: object, counter: str, fault: str) -> None:
    assert frame_fault(wrong(depth_mm=depth), INFO, in_metres=True) == (counter, fault)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Set the time of the check."""
    now_s = [0.0]
    monkeypatch.setattr(
        "services.camera.frame_check.time", SimpleNamespace(monotonic=lambda: now_s[0])
    )

    def set_clock(time_s: float) -> None:
        now_s[0] = time_s

    return set_clock


@pytest.mark.parametrize(
    ("times_s", "is_hopeless"),
    [([0.0] * 30, False), ([0.0] * 19 + [3.0], True), ([10.0 * k for k in range(19)], False)],
)
def test_source_is_hopeless_after_20_rejected_frames_and_3_s(
    times_s: Sequence[float], is_hopeless: bool, clock: Callable[[float], None]
) -> None:
    check = FrameCheck(INFO)
    for time_s in times_s:
        clock(time_s)
        check.accept(wrong(stamp_ns=1.5))
    assert check.hopeless == is_hopeless


def test_source_with_one_good_frame_is_never_hopeless(clock: Callable[[float], None]) -> None:
    check = FrameCheck(INFO)
    check.accept(GOOD)
    for k in range(50):
        clock(float(k))
        check.accept(wrong(stamp_ns=1.5))
    assert not check.hopeless


def test_good_frame_ends_the_fault() -> None:
    check = FrameCheck(INFO)
    assert not check.accept(wrong(stamp_ns=1.5))
    assert check.fault
    assert check.accept(GOOD)
    assert (check.fault, check.counters) == ("", {"wrong_stamp": 1})


def test_calibration_in_the_stream_sets_the_size() -> None:
    check = FrameCheck(None)
    larger = MemorySource([]).info
    assert check.accept(SourceSetup(larger, (), moves=False, stamp_ns=0))
    assert not check.accept(capture(0, (3, 4), (3, 4)))
    assert check.counters == {"wrong_size": 1}
