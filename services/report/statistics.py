"""Statistics of a run."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from common.geometry.transform_buffer import TransformBuffer
from common.metrics.live import LiveScorer
from common.runtime.latency import end_to_end, merge_stages, percentiles, segments
from common.runtime.synchroniser import SynchronisedFrame
from common.runtime.throughput import losses
from people4d.messages import (
    CameraInfo,
    Detections,
    Health,
    Message,
    MovingTransform,
    Odometry,
    RgbdFrame,
    Span,
    StaticTransform,
    Tally,
    Tracks,
    Truth,
)
from services.report.even_sample import EvenSample
from services.report.limits import RunLimits
from services.report.series import RunSeries

SAMPLES = 10_000  # maximum number of samples of a stage
MAX_STAGES = 128
END_TO_END = "end_to_end"
MAX_TRACKS = 100_000
MAX_INSTANCES = 64
MAX_ERRORS = 10_000  # maximum number of position errors for the median


class Percentiles(msgspec.Struct, frozen=True, kw_only=True):
    """Distribution of a duration."""

    p50_ms: float  # [ms] median
    p95_ms: float  # [ms]
    p99_ms: float  # [ms]
    count: int  # number of messages


class Latency:
    """Durations of all segments of the trace, and their sum, end to end.

    Between hosts, `transport` includes the difference of their clocks.
    """

    def __init__(self) -> None:
        self._samples: dict[str, EvenSample[float]] = {}

    def add_trace(self, trace: Sequence[Span]) -> None:
        """Add the trace of one message, oldest stage first; segments of one name are merged."""
        for segment in merge_stages(segments(trace)):
            self._add(segment.name, segment.ms)
        if total := end_to_end(trace):
            self._add(END_TO_END, total.ms)

    def percentiles(self) -> dict[str, Percentiles]:
        """Return the distribution of each stage in the order of the trace, end to end last."""
        rows = {}
        for name in sorted(self._samples, key=lambda name: name == END_TO_END):
            p50, p95, p99 = percentiles(self._samples[name].values)
            count = self._samples[name].count
            rows[name] = Percentiles(p50_ms=p50, p95_ms=p95, p99_ms=p99, count=count)
        return rows

    def _add(self, name: str, duration_ms: float) -> None:
        if name in self._samples or len(self._samples) < MAX_STAGES:
            self._samples.setdefault(name, EvenSample(SAMPLES)).add_value(duration_ms)


class RunSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Statistics of a run; figures without messages are null."""

    cameras: tuple[str, ...]  # names, sorted
    frames: int  # number of received frames
    frames_detected: int  # number of frames with an answer of the detector
    frames_tracked: int  # number of frames with an answer of the tracker
    recorded_hz: float | None  # [Hz] rate of the frames of one camera by their stamps
    processed_hz: float | None  # [Hz] rate of tracked frames by the clock
    model: str | None  # model of the detector
    people: int  # number of detections over all frames
    people_per_frame: float | None
    position_share: float | None  # share of detections with a 3D position, 0 to 1
    tracker: str | None  # method of the tracker
    tracks: int  # number of confirmed tracks
    track_length_mean: float | None  # [frames] mean duration of confirmed tracks
    track_length_median: float | None  # [frames] median duration of confirmed tracks
    latency: dict[str, Percentiles]  # distribution by stage, and "end_to_end"
    drops: dict[str, dict[str, int]]  # numbers of losses by instance and cause
    score: Tally | None  # score against the truth, as by people4d score
    position_error_median_m: float | None  # [m] median horizontal error of matches
    degraded: tuple[str, ...]  # service and reason of each limit of the run; empty: none
    unused: tuple[str, ...]  # unused inputs: odometry, mount, truth
    lockstep: bool  # True: playback in lock-step, latency includes waiting
    missing: tuple[str, ...]  # streams without messages


@dataclass(slots=True)
class _Events:
    """First, last and number of some events."""

    first_ns: int = 0
    last_ns: int = 0
    count: int = 0

    def add_event(self, time_ns: int) -> None:
        self.first_ns = self.first_ns if self.count else time_ns
        self.last_ns = time_ns
        self.count += 1

    def rate_hz(self) -> float | None:
        seconds = (self.last_ns - self.first_ns) / 1e9
        return (self.count - 1) / seconds if self.count > 1 and seconds > 0 else None


class RunStatistics:
    """Statistics of messages in bounded memory.

    Args:
        truth: Configured source of ground truth; empty: none.
    """

    def __init__(self, truth: str = "") -> None:
        self._now_ns = 0
        self._frames: dict[str, _Events] = {}
        self._processed = _Events()
        self._answers: Counter[str] = Counter()
        self._detections: Counter[str] = Counter()
        self._received: Counter[str] = Counter()
        self._names: dict[str, str] = {}
        self._track_frames: Counter[int] = Counter()
        self._latency = Latency()
        self._transforms = TransformBuffer()
        self._scorer = LiveScorer(self._transforms, Counter())
        self._score: Tally | None = None
        self._errors_m: EvenSample[float] = EvenSample(MAX_ERRORS)
        self._health: dict[str, Health] = {}
        self._limits = RunLimits(truth)
        self._lockstep = False
        self.series = RunSeries()

    def add_message(self, message: Message, now_ns: int) -> None:
        """Count a message that arrived at this monotonic time."""
        self._now_ns = now_ns
        self._received[type(message).__name__] += 1
        self._limits.add_message(message, now_ns)
        if isinstance(message, RgbdFrame):
            self._lockstep = message.lockstep
            self._frames.setdefault(message.camera, _Events()).add_event(message.stamp_ns)
        elif isinstance(message, Detections):
            self._names["model"] = message.model
            self._detections["all"] += len(message.detections)
            self._detections["positions"] += sum(
                p.position_m is not None for p in message.detections
            )
        elif isinstance(message, Truth):
            self._scorer.add_truth(message)
        elif isinstance(message, Tracks):
            self._scorer.add_tracks(message)
        elif isinstance(message, CameraInfo):
            self._scorer.views.add_camera(message)
        elif isinstance(message, StaticTransform | MovingTransform | Odometry):
            self._transforms.add_transform(message)
        elif isinstance(message, Health):
            known = message.instance in self._health
            if known or len(self._health) < MAX_INSTANCES:
                self._health[message.instance] = message
        self._update_score()

    def settle(self, frame: SynchronisedFrame) -> None:
        """Count the answers to a frame; tracks predicted between frames do not count."""
        if frame.image is not None:
            self._answers["detected"] += frame.detections is not None
            self._answers["tracked"] += frame.tracks is not None
        if frame.tracks is not None and (frame.image is not None or frame.detections is not None):
            self._add_tracks(frame.tracks)
            self.series.add_frame(frame)

    def summary(self) -> RunSummary:
        """Return the figures so far."""
        rates = [r for span in self._frames.values() if (r := span.rate_hz()) is not None]
        errors_m = self._errors_m.values
        lengths = list(self._track_frames.values())
        detections = self._received["Detections"]
        people = self._detections["all"]
        return RunSummary(
            cameras=tuple(sorted(self._frames)),
            frames=self._received["RgbdFrame"],
            frames_detected=self._answers["detected"],
            frames_tracked=self._answers["tracked"],
            recorded_hz=float(np.median(rates)) if rates else None,
            processed_hz=self._processed.rate_hz(),
            model=self._names.get("model"),
            people=people,
            people_per_frame=people / detections if detections else None,
            position_share=self._detections["positions"] / people if people else None,
            tracker=self._names.get("tracker"),
            tracks=len(lengths),
            track_length_mean=float(np.mean(lengths)) if lengths else None,
            track_length_median=float(np.median(lengths)) if lengths else None,
            latency=self._latency.percentiles(),
            drops=self._drops(),
            score=self._score,
            position_error_median_m=float(np.median(errors_m)) if errors_m else None,
            degraded=self._limits.degraded(self._score is not None),
            unused=self._limits.unused(),
            lockstep=self._lockstep,
            missing=self._missing(),
        )

    def _add_tracks(self, message: Tracks) -> None:
        self._names["tracker"] = message.tracker
        self._processed.add_event(self._now_ns)
        self._latency.add_trace(message.trace)
        for track in message.tracks:
            known = track.id in self._track_frames
            if track.state == "confirmed" and (known or len(self._track_frames) < MAX_TRACKS):
                self._track_frames[track.id] += 1

    def _update_score(self) -> None:
        for score in self._scorer.due():
            self._score = score.total
            for person in score.people:
                if person.position_error_m is not None:
                    error_m = float(np.linalg.norm(person.position_error_m))
                    self._errors_m.add_value(error_m)
                    self.series.add_error(score.stamp_ns, error_m)

    def _drops(self) -> dict[str, dict[str, int]]:
        found = {name: losses(health.counters) for name, health in sorted(self._health.items())}
        return {name: causes for name, causes in found.items() if causes}

    def _missing(self) -> tuple[str, ...]:
        kinds = (RgbdFrame, Detections, Tracks, Truth, Health)
        return tuple(kind.__name__ for kind in kinds if not self._received[kind.__name__])
