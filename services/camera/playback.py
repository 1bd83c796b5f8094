"""Playback of a part of a source, once or in a loop."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from common.io.odometry_order import odometry_first
from common.io.recording import open_recording
from people4d.messages import CompressedRgbdFrame, MovingTransform, Odometry, RgbdFrame
from services.camera.source import Source, SourceFrame, SourceItem, SourceSetup
from services.camera.sources import kind_of, open_source

ONE_FRAME_NS = 33_333_333  # stands in for the time between frames where there is one frame only


@dataclass(frozen=True)
class Selection:
    """The part of a source that is played."""

    start_s: float = 0.0  # seconds left out at the beginning
    duration_s: float = 0.0  # seconds played; 0 plays all
    max_frames: int = 0  # frames played in all; 0 plays all
    stride: int = 1  # every n-th frame is played
    loop: bool = False  # repeat from the start


def play(
    source: Source, selection: Selection, accept: Callable[[SourceItem], bool] = lambda _: True
) -> Iterator[SourceItem]:
    """Yield the selected part of a source; each repetition shifts the stamps, so that they rise.

    Items that are not accepted are left out.
    """
    sent, shift_ns = 0, 0
    while True:
        first_ns = last_ns = count = 0
        for item in _one_round(source, selection, accept):
            yield _shifted(item, shift_ns)
            if isinstance(item, Odometry | MovingTransform | SourceSetup):
                continue
            first_ns = min(first_ns, item.stamp_ns) if count else item.stamp_ns
            last_ns = max(last_ns, item.stamp_ns) if count else item.stamp_ns
            count += 1
            sent += 1
            if sent == selection.max_frames:
                return
        if not selection.loop or not count:
            return
        shift_ns += loop_period_ns(first_ns, last_ns, count)


def loop_period_ns(first_ns: int, last_ns: int, count: int) -> int:
    """Return what each round adds to the stamps: first to last frame, and one frame more."""
    length_ns = last_ns - first_ns
    return length_ns + (length_ns // (count - 1) if count > 1 else ONE_FRAME_NS)


def loop_period_s(source: str) -> float:
    """Return the time that a looping camera adds to its stamps each round [s]."""
    kind = kind_of(source)
    if kind in ("plugin", "ros2"):
        return 0.0  # it does not end
    if kind == "recording":
        messages = open_recording(Path(source)).messages(CompressedRgbdFrame, RgbdFrame)
        stamps_ns = [message.stamp_ns for _, message in messages]
    else:
        opened = open_source(source)
        stamps_ns = [item.stamp_ns for item in opened if isinstance(item, SourceFrame)]
        opened.close()
    if not stamps_ns:
        return 0.0
    return loop_period_ns(min(stamps_ns), max(stamps_ns), len(stamps_ns)) / 1e9


def _one_round(
    source: Source, selection: Selection, accept: Callable[[SourceItem], bool]
) -> Iterator[SourceItem]:
    index = 0
    is_part = selection.start_s or selection.duration_s
    items = source.part(selection.start_s, selection.duration_s) if is_part else iter(source)
    items = filter(accept, items)
    for item in items if source.live else odometry_first(items):
        if isinstance(item, Odometry | MovingTransform | SourceSetup):
            yield item
            continue
        if index % selection.stride == 0:
            yield item
        index += 1


def _shifted(item: SourceItem, shift_ns: int) -> SourceItem:
    if not shift_ns:
        return item
    stamp_ns = item.stamp_ns + shift_ns
    if isinstance(item, SourceFrame | SourceSetup):
        return replace(item, stamp_ns=stamp_ns)
    return msgspec.structs.replace(item, stamp_ns=stamp_ns)
