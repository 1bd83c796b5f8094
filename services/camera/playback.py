"""Playback of a part of a source, once or in a loop."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import msgspec

from common.io.odometry_order import odometry_first
from common.io.recording import open_recording
from people4d.messages import CompressedRgbdFrame, MovingTransform, Odometry, RgbdFrame
from services.camera.config import CameraConfig
from services.camera.pacing import MAX_GAP_NS
from services.camera.source import Source, SourceFrame, SourceItem, SourceSetup
from services.camera.sources import kind_of, open_source

ONE_FRAME_NS = 33_333_333  # assumed frame interval of a source with a single frame


class RoundLength:
    """Duration of one round of a loop by the stamps in their order, without jumps of the clock."""

    def __init__(self) -> None:
        self.count = 0  # number of frames
        self._before_ns = 0  # duration of the parts before the last jump
        self._part = (0, 0)  # lowest and highest stamp since the last jump
        self._last_ns = 0

    def add_frame(self, stamp_ns: int) -> None:
        """Add a frame."""
        low_ns, high_ns = self._part
        if not self.count or abs(stamp_ns - self._last_ns) > MAX_GAP_NS:
            self._before_ns += high_ns - low_ns
            low_ns = high_ns = stamp_ns
        self._part = min(low_ns, stamp_ns), max(high_ns, stamp_ns)
        self._last_ns = stamp_ns
        self.count += 1

    @property
    def length_ns(self) -> int:
        """Duration from the first to the last frame, plus one frame interval."""
        low_ns, high_ns = self._part
        length_ns = self._before_ns + high_ns - low_ns
        return length_ns + (length_ns // (self.count - 1) if self.count > 1 else ONE_FRAME_NS)


def play(
    source: Source,
    config: CameraConfig,
    accept: Callable[[SourceItem], SourceItem | None] = lambda item: item,
) -> Iterator[SourceItem]:
    """Yield the configured part of a source; in repetitions stamps are shifted to rise.

    `accept` returns a converted item, or None for a rejected one.
    """
    sent, shift_ns = 0, 0
    while True:
        length = RoundLength()
        for item in _one_round(source, config, accept):
            yield _shifted(item, shift_ns)
            if isinstance(item, Odometry | MovingTransform | SourceSetup):
                continue
            length.add_frame(item.stamp_ns)
            sent += 1
            if sent == config.max_frames:
                return
        if not config.loop or not length.count:
            return
        shift_ns += length.length_ns


def loop_period_s(source: str) -> float:
    """Return the shift of stamps by each round of a looping camera [s]."""
    kind = kind_of(source)
    if kind in ("camera", "plugin", "ros2"):
        return 0.0  # endless source
    length = RoundLength()
    if kind == "recording":
        for _, message in open_recording(Path(source)).messages(CompressedRgbdFrame, RgbdFrame):
            length.add_frame(message.stamp_ns)
    else:
        opened = open_source(source)
        for item in opened:
            if isinstance(item, SourceFrame):
                length.add_frame(item.stamp_ns)
        opened.close()
    return length.length_ns / 1e9 if length.count else 0.0


def _one_round(
    source: Source, config: CameraConfig, accept: Callable[[SourceItem], SourceItem | None]
) -> Iterator[SourceItem]:
    index = 0
    is_part = config.start_s or config.duration_s
    items = source.part(config.start_s, config.duration_s) if is_part else iter(source)
    items = (used for item in items if (used := accept(item)) is not None)
    for item in items if source.live else odometry_first(items):
        if isinstance(item, Odometry | MovingTransform | SourceSetup):
            yield item
            continue
        if index % config.stride == 0:
            yield item
        index += 1


def _shifted(item: SourceItem, shift_ns: int) -> SourceItem:
    if not shift_ns:
        return item
    stamp_ns = item.stamp_ns + shift_ns
    if isinstance(item, SourceFrame | SourceSetup):
        return replace(item, stamp_ns=stamp_ns)
    return msgspec.structs.replace(item, stamp_ns=stamp_ns)
