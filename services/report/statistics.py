"""Counts what the pipeline did."""

from collections import Counter
from dataclasses import dataclass

import msgspec
import numpy as np

from common.runtime.throughput import losses
from people4d.messages import Detections, Health, Message, RgbdFrame, Tracks, Truth
from services.report.accuracy import Accuracy, TruthCheck
from services.report.join import Moment
from services.report.latency import Latency, Percentiles

MAX_TRACKS = 100_000
MAX_INSTANCES = 64


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """What the pipeline did; absent (null) is what no message told."""

    cameras: tuple[str, ...]  # names, sorted
    frames: int  # that the report saw
    frames_detected: int  # of them answered by the detector
    frames_tracked: int  # of them answered by the tracker
    recorded_hz: float | None  # [Hz] rate of one camera's frames by their stamps
    processed_hz: float | None  # [Hz] rate of tracked frames by the clock
    model: str | None  # that found the people
    people: int  # detected, over all frames
    people_per_frame: float | None
    position_share: float | None  # of the detected people who have a 3D position, 0 to 1
    tracker: str | None  # method
    tracks: int  # that were confirmed
    track_length_mean: float | None  # [frames] confirmed
    track_length_median: float | None  # [frames] confirmed
    latency: dict[str, Percentiles]  # by stage, by way between services, and "whole"
    drops: dict[str, dict[str, int]]  # by instance and cause, where there were any
    accuracy: Accuracy | None  # against the truth
    missing: tuple[str, ...]  # streams that brought nothing


@dataclass(slots=True)
class _Span:
    """First, last and number of some events."""

    first_ns: int = 0
    last_ns: int = 0
    count: int = 0

    def add(self, time_ns: int) -> None:
        self.first_ns = self.first_ns if self.count else time_ns
        self.last_ns = time_ns
        self.count += 1

    def rate_hz(self) -> float | None:
        seconds = (self.last_ns - self.first_ns) / 1e9
        return (self.count - 1) / seconds if self.count > 1 and seconds > 0 else None


class Statistics:
    """Adds up messages in bounded memory."""

    def __init__(self) -> None:
        self._now_ns = 0
        self._frames: dict[str, _Span] = {}
        self._processed = _Span()
        self._answered: Counter[str] = Counter()
        self._people: Counter[str] = Counter()
        self._seen: Counter[str] = Counter()
        self._names: dict[str, str] = {}
        self._track_frames: Counter[int] = Counter()
        self._latency = Latency()
        self._truth = TruthCheck()
        self._health: dict[str, Health] = {}

    def add(self, message: Message, now_ns: int) -> None:
        """Count a message.

        Args:
            message: Any of those the report listens to.
            now_ns: Monotonic time at which it came.
        """
        self._now_ns = now_ns
        self._seen[type(message).__name__] += 1
        if isinstance(message, RgbdFrame):
            self._frames.setdefault(message.camera, _Span()).add(message.stamp_ns)
        elif isinstance(message, Detections):
            self._names["model"] = message.model
            self._people["all"] += len(message.detections)
            self._people["placed"] += sum(p.position_m is not None for p in message.detections)
        elif isinstance(message, Truth):
            self._truth.add(message)
        elif isinstance(message, Health):
            known = message.instance in self._health
            if known or len(self._health) < MAX_INSTANCES:
                self._health[message.instance] = message

    def settle(self, moment: Moment) -> None:
        """Count which answers a frame got; tracks predicted between frames do not count."""
        if moment.rgb is not None:
            self._answered["detected"] += moment.detections is not None
            self._answered["tracked"] += moment.tracks is not None
        if moment.tracks is not None and (moment.rgb is not None or moment.detections is not None):
            self._add_tracks(moment.tracks)

    def summary(self) -> Summary:
        """Return the figures so far."""
        rates = [r for span in self._frames.values() if (r := span.rate_hz()) is not None]
        lengths = list(self._track_frames.values())
        detections = self._seen["Detections"]
        people = self._people["all"]
        return Summary(
            cameras=tuple(sorted(self._frames)),
            frames=self._seen["RgbdFrame"],
            frames_detected=self._answered["detected"],
            frames_tracked=self._answered["tracked"],
            recorded_hz=float(np.median(rates)) if rates else None,
            processed_hz=self._processed.rate_hz(),
            model=self._names.get("model"),
            people=people,
            people_per_frame=people / detections if detections else None,
            position_share=self._people["placed"] / people if people else None,
            tracker=self._names.get("tracker"),
            tracks=len(lengths),
            track_length_mean=float(np.mean(lengths)) if lengths else None,
            track_length_median=float(np.median(lengths)) if lengths else None,
            latency=self._latency.percentiles(),
            drops=self._drops(),
            accuracy=self._truth.result(),
            missing=self._missing(),
        )

    def _add_tracks(self, message: Tracks) -> None:
        self._names["tracker"] = message.tracker
        self._processed.add(self._now_ns)
        self._latency.add(message.trace)
        self._truth.add(message)
        for track in message.tracks:
            known = track.id in self._track_frames
            if track.state == "confirmed" and (known or len(self._track_frames) < MAX_TRACKS):
                self._track_frames[track.id] += 1

    def _drops(self) -> dict[str, dict[str, int]]:
        found = {name: losses(health.counters) for name, health in sorted(self._health.items())}
        return {name: causes for name, causes in found.items() if causes}

    def _missing(self) -> tuple[str, ...]:
        kinds = (RgbdFrame, Detections, Tracks, Truth, Health)
        return tuple(kind.__name__ for kind in kinds if not self._seen[kind.__name__])
