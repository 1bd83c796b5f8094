"""A source in memory."""

from collections.abc import Iterator, Sequence

import numpy as np

from people4d.messages import Odometry
from services.camera.calibration import Intrinsics, camera_info
from services.camera.source import Source, SourceFrame
from tests import builders

SIZE = (6, 8)


def capture(
    stamp_ms: int, size: tuple[int, int] = SIZE, depth_size: tuple[int, int] = SIZE
) -> SourceFrame:
    rgb, depth_mm = np.zeros((*size, 3), np.uint8), np.zeros(depth_size, np.uint16)
    return SourceFrame(rgb, depth_mm, stamp_ms * 1_000_000)


def odometry(stamp_ms: int) -> Odometry:
    return builders.odometry(stamp_ns=stamp_ms * 1_000_000)


class MemorySource(Source):
    """Yields a list; an exception in it is raised."""

    def __init__(
        self, items: Sequence[SourceFrame | Odometry | Exception], live: bool = False
    ) -> None:
        self.info = camera_info(Intrinsics(fx=10, fy=10, cx=4, cy=3), SIZE)
        self.live = live
        self.items = items
        self.closed = False

    def __iter__(self) -> Iterator[SourceFrame | Odometry]:
        for item in self.items:
            if isinstance(item, Exception):
                raise item
            yield item

    def close(self) -> None:
        self.closed = True
