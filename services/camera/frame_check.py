"""Checks of frames against the declaration of their source."""

import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from people4d.messages import CameraInfo
from services.camera.ros.images import millimetres
from services.camera.source import MotionMessage, SourceFrame, SourceItem, SourceSetup

METRES_MAX = 50  # maximum reading [mm] of a depth image in metres, below the range of sensors
RANGE_MAX_M = 65.535  # [m] range of 16 bits of millimetres
GRID = 16  # [px] step between checked readings
HOPELESS_FRAMES = 20  # number of rejected frames without an accepted one that ends a source
HOPELESS_S = 3.0  # [s] minimum time from the first rejected frame to the end of a source


class FrameCheck:
    """Rejects frames of another type or size than declared; `accept` runs in the reading thread.

    Args:
        info: Calibration of the frames; None until a SourceSetup.
        in_metres: Depth is declared as float metres, which `accept` converts.
    """

    def __init__(self, info: CameraInfo | None, in_metres: bool = False) -> None:
        self._info, self._in_metres = info, in_metres
        self._first_s: float | None = None  # monotonic time of the first frame, if rejected
        self._accepted = False
        # Counter and description of the last frame's fault, empty if none
        self.cause = self.fault = ""
        self.hopeless = False  # True if all frames were rejected
        self.counters: Mapping[str, int] = {}  # number of rejected frames by cause

    def accept(self, item: SourceItem) -> SourceItem | None:
        """Return an accepted item, converted, or None; calibration and motion pass."""
        if isinstance(item, SourceSetup):
            self._info = item.info
        if isinstance(item, MotionMessage | SourceSetup) or self._info is None:
            return item
        self.cause, self.fault = frame_fault(item, self._info, self._in_metres)
        if self.cause:
            self._reject()
            return None
        self._accepted, self.hopeless = True, False
        return replace(item, depth_mm=millimetres(item.depth_mm)) if self._in_metres else item

    def _reject(self) -> None:
        now_s = time.monotonic()
        self._first_s = now_s if self._first_s is None else self._first_s
        # A new mapping: another thread may read the old one.
        self.counters = {**self.counters, self.cause: self.counters.get(self.cause, 0) + 1}
        is_long = now_s - self._first_s >= HOPELESS_S
        count = sum(self.counters.values())
        self.hopeless = not self._accepted and is_long and count >= HOPELESS_FRAMES


def frame_fault(frame: object, info: CameraInfo, in_metres: bool = False) -> tuple[str, str]:
    """Return counter and description of a frame's fault; both empty if there is none."""
    if not isinstance(frame, SourceFrame):
        return "wrong_type", f"it yields {type(frame).__name__}, expected SourceFrame"
    size, stamp_ns = (info.height, info.width), _any(frame.stamp_ns)
    depth_kind: type[np.generic] = np.floating if in_metres else np.uint16
    unit = "metres" if in_metres else "millimetres"
    images: tuple[tuple[str, object, type[np.generic], tuple[int, ...], str], ...] = (
        ("rgb", _any(frame.rgb), np.uint8, (*size, 3), "red first"),
        ("depth_mm", _any(frame.depth_mm), depth_kind, size, unit),
    )
    if not isinstance(stamp_ns, int):
        found = type(stamp_ns).__name__
        return "wrong_stamp", f"stamp_ns is {found}, expected int nanoseconds"
    for name, image, kind, shape, meaning in images:
        if not isinstance(image, np.ndarray):
            return "wrong_type", f"{name} is {type(image).__name__}, expected an array of numpy"
        wrong_type = not np.issubdtype(image.dtype, kind)
        if wrong_type or image.shape != shape:
            cause = "wrong_type" if wrong_type else "wrong_size"
            expected = f"{_name(kind)} {shape} {meaning}"
            return cause, f"{name} is {image.dtype} {image.shape}, expected {expected}"
    return _unit_fault(frame, in_metres)


def _unit_fault(frame: SourceFrame, in_metres: bool) -> tuple[str, str]:
    """Return the fault of the depth unit, by a grid of readings."""
    depth = frame.depth_mm[::GRID, ::GRID]
    if in_metres:
        smallest = float(np.min(depth, initial=np.inf, where=depth > 0))
        if RANGE_MAX_M < smallest < np.inf:
            return "wrong_unit", f"depth is {smallest:g} at least: millimetres, declared as metres"
    elif 0 < (largest := int(depth.max(initial=0))) < METRES_MAX:
        return "wrong_unit", f"depth_mm is {largest} at most: metres, expected millimetres"
    return "", ""


def _name(kind: type[np.generic]) -> str:
    return "float" if kind is np.floating else np.dtype(kind).name


def _any(value: object) -> object:
    """Return a value without its declared type, which a plug-in need not keep."""
    return value
