"""What every RGB-D source looks like to the camera service: numpy out, no camera SDK."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from common.messages import U8, U16, CameraInfo, Odometry, StaticTransform


@dataclass(frozen=True)
class Capture:
    """One RGB-D image pair.

    Args:
        rgb: HxWx3, red first.
        depth_mm: HxW in millimetres, aligned to rgb, 0 = no reading.
        stamp_ns: Acquisition time in nanoseconds.
    """

    rgb: U8
    depth_mm: U16
    stamp_ns: int


class Source(ABC):
    """A camera or a recording of one.

    A source sets `info` in its constructor and yields captures, and odometry where it has any, in
    the order in which they were taken. It may raise `SourceError` at any time; what came before
    is used. A recording can be iterated more than once, from the start each time.
    """

    info: CameraInfo  # calibration; the configuration may overrule `camera` and `max_depth_m`
    transforms: Sequence[StaticTransform] = ()  # where the camera sits, if the source knows
    counters: Mapping[str, int] = MappingProxyType({})  # events since opening, drops by cause
    live: bool = False  # True: a device, whose newest capture matters; False: a recording

    @abstractmethod
    def __iter__(self) -> Iterator[Capture | Odometry]:
        """Yield what the camera saw, oldest first."""

    def close(self) -> None:
        """Release the device or the file; the base class has nothing to release."""
        return
