"""Frames of another type, size, unit or stamp than declared, as plug-in cameras give them."""

from dataclasses import replace
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
        (
            wrong(depth_mm=None),
            "wrong_type",
            "depth_mm is NoneType, expected an array of numpy",
        ),
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
    ],
)
def test_wrong_frame_is_named(frame: object, counter: str, fault: str) -> None:
    assert frame_fault(frame, INFO) == (counter, fault)


@pytest.mark.parametrize("depth", [0, 50, 5000])
def test_depth_in_millimetres_and_an_empty_one_pass(depth: int) -> None:
    assert frame_fault(wrong(depth_mm=np.full(SIZE, depth, np.uint16)), INFO) == ("", "")


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
