"""Schedule of crops: a person apart from others needs an embedding a few times a second.

Crops of a person repeat each other, and positions suffice to continue the track of a person who is
apart from others (docs/method.md section 21).
"""

import threading
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.geometry.boxes import iou_xyxy
from people4d.messages import F64, RgbdFrame

INTERVAL_NS = 250_000_000  # maximum interval between two crops of a person [ns]
CHANGE_NS = 500_000_000  # duration of crops in every frame after a change [ns]
IOU_MIN = 0.5  # minimum overlap of a person's boxes in two frames
GAP_MAX_NS = 200_000_000  # maximum interval between two frames of a camera [ns]

I64 = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class _People:
    """People of the last frame of a camera."""

    stamp_ns: int  # [ns] stamp of the frame
    boxes: F64  # Nx4
    changed_ns: I64  # [ns] N, last changes
    cropped_ns: I64  # [ns] N, last crops


class CropSchedule:
    """Decides which people of each frame get crops."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._last: dict[str, _People] = {}  # last people by camera with a calibration

    def due(self, frame: RgbdFrame, boxes: F64) -> list[bool]:
        """Return True for each person (boxes Nx4, xyxy, pixels) who needs a crop in this frame.

        A change is a box that overlaps another one, or not exactly one of the previous frame.
        """
        stamp_ns = frame.stamp_ns
        changed_ns = np.full(len(boxes), stamp_ns)
        cropped_ns = changed_ns.copy()
        with self._lock:
            last = self._last.get(frame.camera)
            if last is not None and 0 < stamp_ns - last.stamp_ns <= GAP_MAX_NS:
                now, before = unchanged(boxes, last.boxes)
                changed_ns[now], cropped_ns[now] = last.changed_ns[before], last.cropped_ns[before]
            due = stamp_ns - changed_ns < CHANGE_NS
            due |= stamp_ns - cropped_ns >= INTERVAL_NS
            cropped_ns[due] = stamp_ns
            self._last[frame.camera] = _People(stamp_ns, boxes, changed_ns, cropped_ns)
        return [bool(one) for one in due]


def unchanged(boxes: F64, before: F64) -> tuple[I64, I64]:
    """Return the unchanged boxes (indices of Nx4), and their boxes in the previous frame (Mx4)."""
    overlaps = iou_xyxy(boxes, np.concatenate([boxes, before]))
    apart = np.count_nonzero(overlaps[:, : len(boxes)], axis=1) == 1
    overlaps = overlaps[:, len(boxes) :]
    pairs = overlaps > 0
    one = (overlaps >= IOU_MIN) & apart[:, None]
    one &= (np.count_nonzero(pairs, axis=1) == 1)[:, None] & (np.count_nonzero(pairs, axis=0) == 1)
    now, then = np.nonzero(one)
    return now, then
