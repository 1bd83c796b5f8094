"""Interface of RGB-D sources: numpy out, no camera SDK."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, TypeAlias

from common.config import Config
from people4d.messages import U8, U16, CameraInfo, MovingTransform, Odometry, StaticTransform
from services.camera.folder.registration import Registration

MotionMessage: TypeAlias = Odometry | MovingTransform  # motion of the base, or of the camera on it


@dataclass(frozen=True)
class SourceFrame:
    """One RGB-D image pair."""

    rgb: U8  # HxWx3, red first
    depth_mm: U16  # HxW in millimetres, aligned to rgb, 0 = no reading
    stamp_ns: int  # acquisition time in nanoseconds


@dataclass(frozen=True)
class ConnectedCamera:
    """A camera that is plugged in."""

    model: str
    serial: str  # serial number; empty if unknown
    problem: str  # reason why it cannot be used, with the remedy; empty if it can


@dataclass(frozen=True)
class SourceSetup:
    """Calibration and mount of a source, initial or changed while it runs."""

    info: CameraInfo  # calibration of the following frames
    transforms: Sequence[StaticTransform]  # pose of the camera; empty if unknown
    moves: bool  # True: transforms of the camera follow, so no mount is needed
    stamp_ns: int  # [ns] stamp of the next frame


SourceItem: TypeAlias = SourceFrame | MotionMessage | SourceSetup


class Source(ABC):
    """A camera or a recording of one.

    A source sets `info` in its constructor, unless `calibrates_late`, and yields frames, and
    odometry if it has any, in the order of their acquisition. It may raise `SourceError` at any
    time; earlier items are used. A recording can be iterated more than once, from the start each
    time.
    """

    options_type: ClassVar[type[Config]] = Config  # options that the constructor takes
    info: CameraInfo  # calibration; the configuration may override `camera` and `max_depth_m`
    transforms: Sequence[StaticTransform] = ()  # pose of the camera, if known
    registration: Registration | None = None  # moves depth into the view of colour
    moves: bool = False  # True: the source yields transforms of the camera, so no mount is needed
    # Number of events since opening, and of drops by cause
    counters: Mapping[str, int] = MappingProxyType({})
    depth_in_metres: bool = False  # True: depth_mm of its frames is float metres, to be converted
    live: bool = False  # True: a device, whose newest frame matters; False: a recording
    # True: `info` is not set, but yielded in a SourceSetup before the first frame
    calibrates_late: ClassVar[bool] = False
    problem: str = ""  # reason of missing frames, one sentence; empty if frames arrive

    @classmethod
    def connected(cls) -> Sequence[ConnectedCamera]:
        """Return the cameras of this kind that are plugged in; the base class finds none."""
        return ()

    @abstractmethod
    def __iter__(self) -> Iterator[SourceItem]:
        """Yield frames and motion, oldest first."""

    def part(self, start_s: float, duration_s: float) -> Iterator[SourceItem]:
        """Yield the items of a period since the first one; a duration of 0 has no end."""
        start_ns, length_ns = int(start_s * 1e9), int(duration_s * 1e9)
        origin_ns: int | None = None
        started = False
        for item in self:
            origin_ns = item.stamp_ns if origin_ns is None else origin_ns
            elapsed_ns = item.stamp_ns - origin_ns
            # Playback stays started: after a clock jump the elapsed time is meaningless.
            started = started or elapsed_ns >= start_ns
            if started and length_ns and elapsed_ns > start_ns + length_ns:
                return
            if started:
                yield item

    def interrupt(self) -> None:  # noqa: B027
        """Interrupt a waiting iterator; called from another thread, before `close`."""

    def close(self) -> None:
        """Release the device or the file; the base class has nothing to release."""
        return
