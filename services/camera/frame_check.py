"""Checks that the frames of a source are as declared, and names what is not."""

from collections.abc import Mapping

import numpy as np

from people4d.messages import CameraInfo
from services.camera.source import MotionMessage, SourceFrame, SourceItem, SourceSetup

METRES_MAX = 50  # largest reading [mm] of a depth image in metres; sensors begin beyond
GRID = 16  # [px] between the readings that are looked at


class FrameCheck:
    """Rejects frames of another type or size than declared; `accept` runs in the reading thread.

    Args:
        info: Calibration of the frames; None until a SourceSetup brings it.
    """

    def __init__(self, info: CameraInfo | None) -> None:
        self._info = info
        self.fault = ""  # what is wrong with the last frame, empty if nothing
        self.counters: Mapping[str, int] = {}  # rejected frames by cause

    def accept(self, item: SourceItem) -> bool:
        """Check an item; calibration and motion pass."""
        if isinstance(item, SourceSetup):
            self._info = item.info
        if isinstance(item, MotionMessage | SourceSetup) or self._info is None:
            return True
        cause, self.fault = frame_fault(item, self._info)
        if cause:  # a new mapping: another thread may read the old one
            self.counters = {**self.counters, cause: self.counters.get(cause, 0) + 1}
        return not cause


def frame_fault(frame: object, info: CameraInfo) -> tuple[str, str]:
    """Return the counter of what is wrong with a frame, and a sentence; both empty if nothing."""
    if not isinstance(frame, SourceFrame):
        return "wrong_type", f"it yields {type(frame).__name__}, expected SourceFrame"
    size, stamp_ns = (info.height, info.width), _any(frame.stamp_ns)
    images = (
        ("rgb", _any(frame.rgb), np.uint8, (*size, 3), "red first"),
        ("depth_mm", _any(frame.depth_mm), np.uint16, size, "millimetres"),
    )
    if not isinstance(stamp_ns, int):
        found = type(stamp_ns).__name__
        return "wrong_stamp", f"stamp_ns is {found}, expected int nanoseconds"
    for name, image, kind, shape, meaning in images:
        if not isinstance(image, np.ndarray):
            return "wrong_type", f"{name} is {type(image).__name__}, expected an array of numpy"
        wrong_type = image.dtype != kind
        if wrong_type or image.shape != shape:
            cause = "wrong_type" if wrong_type else "wrong_size"
            expected = f"{np.dtype(kind)} {shape} {meaning}"
            return cause, f"{name} is {image.dtype} {image.shape}, expected {expected}"
    if 0 < (largest := int(frame.depth_mm[::GRID, ::GRID].max(initial=0))) < METRES_MAX:
        return "wrong_unit", f"depth_mm is {largest} at most: metres, expected millimetres"
    return "", ""


def _any(value: object) -> object:
    """Return a value without its declared type, which a plug-in need not keep."""
    return value
