"""Series over the time of a run, in bounded memory, for the plots of the page."""

from dataclasses import dataclass

from common.runtime.latency import end_to_end
from common.runtime.synchroniser import SynchronisedFrame
from services.report.even_sample import EvenSample

POINTS = 600  # minimum number of points of a series, if there are enough frames


@dataclass(frozen=True, slots=True)
class FramePoint:
    """Figures of one frame."""

    time_s: float  # [s] stamp since the first frame
    detections: int  # number of detections
    tracks: int  # number of confirmed tracks
    latency_ms: float | None  # [ms] end to end; None if there is no trace


@dataclass(frozen=True, slots=True)
class ErrorPoint:
    """Error of one person's position in one frame."""

    time_s: float  # [s] stamp of the frame since the first frame
    error_m: float  # [m] horizontal


class RunSeries:
    """Gathers points of frames, and errors of positions."""

    def __init__(self) -> None:
        self._frames: EvenSample[FramePoint] = EvenSample(POINTS)
        self._errors: EvenSample[ErrorPoint] = EvenSample(POINTS)
        self._first_ns: int | None = None

    @property
    def frames(self) -> list[FramePoint]:
        """Points of frames."""
        return self._frames.values

    @property
    def errors(self) -> list[ErrorPoint]:
        """Errors of positions."""
        return self._errors.values

    def add_frame(self, frame: SynchronisedFrame) -> None:
        """Add a frame; frames without tracks are ignored."""
        if frame.tracks is None:
            return
        total = end_to_end(frame.tracks.trace)
        self._frames.add_value(
            FramePoint(
                time_s=self._seconds(frame.stamp_ns),
                detections=len(frame.detections.detections) if frame.detections else 0,
                tracks=sum(track.state == "confirmed" for track in frame.tracks.tracks),
                latency_ms=total.ms if total else None,
            )
        )

    def add_error(self, stamp_ns: int, error_m: float) -> None:
        """Add the error of a person's position."""
        self._errors.add_value(ErrorPoint(self._seconds(stamp_ns), error_m))

    def _seconds(self, stamp_ns: int) -> float:
        if self._first_ns is None:
            self._first_ns = stamp_ns
        return max(stamp_ns - self._first_ns, 0) / 1e9
