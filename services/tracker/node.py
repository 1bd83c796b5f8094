"""Node of the tracker: detections and embeddings in, tracks out."""

from collections import Counter
from collections.abc import Sequence
from typing import ClassVar

import msgspec

from common.io.packed import pack, unpack
from common.runtime.node import LoopCallbacks, StatefulNode, Status
from common.transport.trace import span
from people4d.errors import DecodeError
from people4d.messages import (
    F64,
    AreaPeople,
    CameraInfo,
    Detections,
    Embeddings,
    Message,
    MovingTransform,
    Odometry,
    StaticTransform,
    Track,
    Tracks,
)
from services.tracker.areas.exchange import AreaExchange
from services.tracker.areas.hosts import CameraHosts
from services.tracker.cameras.absence import CameraAbsence
from services.tracker.cameras.clocks import CameraClocks
from services.tracker.cameras.drift import CameraDrift
from services.tracker.cameras.frame_join import FrameJoin, PendingFrame
from services.tracker.cameras.poses import CameraPoseLookup
from services.tracker.cameras.stamp_guard import ArrivedFrame, StampGuard
from services.tracker.config import TrackerConfig
from services.tracker.interface import LATE_MAX_NS, Observation, Tracker
from services.tracker.observe import FrameObserver
from services.tracker.output import TrackerOutput
from services.tracker.prediction_schedule import PredictionSchedule

TRANSFORMS = StaticTransform | MovingTransform | Odometry
ODOMETRY_WAIT_NS = 50_000_000  # maximum wait for the odometry of a frame [ns]
COUNTERS = (
    *("no_transform", "predicted_base", "clock_resets", "transform_changes", "predictions"),
    *("without_position", "out_of_range", "empty_boxes", "bad_embeddings", "too_many"),
    *("late_frames", "tracker_failures", "refused_cameras"),
)


class NodeCheckpoint(msgspec.Struct, frozen=True, kw_only=True):
    """The state of the service."""

    method: str  # tracker, yaw and frame of the tracks
    stamp_ns: int  # [ns] time of the last frame tracked
    camera_poses: dict[str, F64]  # 4x4 by optical frame, of fixed cameras
    tracker: bytes  # checkpoint of the tracker
    # [ns] offset subtracted from the stamps of each camera; the reference is first
    clock_offsets_ns: dict[str, int] = {}


class TrackerNode(StatefulNode):
    """Joins the streams by camera and stamp, and tracks in one fixed frame.

    Every Detections gives one Tracks of the same stamp, except for counted drops: `stale` (too
    late), `duplicates` (from two detectors), `no_transform`, `refused_cameras` (too many) and
    `stray_frames` (see StampGuard). CameraClocks corrects stamps of several cameras to one time.
    If detections stop, predicted tracks are published for EXTRAPOLATION_MAX_NS, marked as
    predicted.
    """

    inputs: tuple[type[Message], ...] = (
        *(Detections, Embeddings),
        *(CameraInfo, StaticTransform, MovingTransform, Odometry),
    )
    required_inputs: ClassVar[tuple[type[Message], ...]] = (Detections,)

    def __init__(self, config: TrackerConfig, tracker: Tracker) -> None:
        self._config, self._tracker = config, tracker
        self._method = f"{config.tracker}, yaw {config.yaw}, in {config.frame_id}"
        self._clocks = CameraClocks()
        self._guard = StampGuard(self._clocks)
        self._now_ns = 0
        self._last_ns: int | None = None  # time of the newest frame tracked [ns]
        self._is_restored = False  # True if that frame is from a checkpoint
        self._join = FrameJoin(config, self._tracker.uses_embeddings)
        self._poses = CameraPoseLookup(config.frame_id, config.require_transform)
        self._output = TrackerOutput(config, self._poses)
        self._drift, self._absence = CameraDrift(), CameraAbsence()
        self._hosts = CameraHosts(config.area.hosts)
        self._areas = AreaExchange(config.area, config.frame_id, self._tracker)
        self._held: PendingFrame | None = None  # frame that waits for its odometry
        self._schedule = PredictionSchedule()
        self._counters = Counter(dict.fromkeys(COUNTERS, 0))
        self._observer = FrameObserver(self._poses, self._counters)

    def attach(self, loop: LoopCallbacks) -> None:
        """Subscribe to cameras of other hosts and to neighbouring areas."""
        self.foreign_inputs = [*self._hosts.topics(loop.robot), *self._areas.attach(loop.robot)]

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Process one message and return the tracks that follow from it."""
        flushed: list[Message] = []
        self._now_ns = now_ns
        if isinstance(message, Detections):
            flushed = self._add_frames(self._guard.admit(message, now_ns))
        elif isinstance(message, Embeddings) and self._tracker.uses_embeddings:
            self._join.add_embeddings(message)
        elif isinstance(message, AreaPeople):
            self._areas.receive(message, now_ns, self._schedule.time_ns(now_ns))
        elif isinstance(message, CameraInfo):
            self._observer.add_calibration(message)
        elif isinstance(message, TRANSFORMS) and self._poses.add_transform(message):
            # Tracks are relative to the previous pose of the camera.
            self._counters["transform_changes"] += 1
            self._tracker.reset()
            self._drift.clear()
            self._absence.clear()
        return [*flushed, *self._track_due(now_ns)]

    def tick(self, now_ns: int) -> Sequence[Message]:
        """Return tracks of frames whose wait is over, and predictions."""
        self._now_ns = now_ns
        flushed = self._add_frames(self._guard.due(now_ns))
        tracks = self._track_due(now_ns) or self._predict_due(now_ns)
        return [*flushed, *tracks, *self._areas.due(now_ns, self._schedule.time_ns(now_ns))]

    def flush(self, now_ns: int) -> Sequence[Message]:
        """Return tracks of all waiting frames."""
        flushed = self._add_frames(self._guard.due(now_ns, flush=True))
        return [*flushed, *self._track_due(now_ns, flush=True)]

    def wake_ns(self) -> int | None:
        """Return the time at which the wait of a frame is over or a prediction is due."""
        due_ns = self._join.wake_ns() if self._join.waiting else self._schedule.wake_ns
        waking = [due_ns, self._guard.wake_ns(), self._areas.wake_ns()]
        if self._held:
            waking = [self._held.arrived_ns + ODOMETRY_WAIT_NS, self._areas.wake_ns()]
        return min((ns for ns in waking if ns is not None), default=None)

    def status(self) -> Status:
        """Report missing inputs and counters."""
        reasons = []
        if self._poses.without_transform:
            frames = ", ".join(sorted(self._poses.without_transform))
            dropped = self._config.require_transform
            effect = "frames are dropped" if dropped else "the camera is taken as the origin"
            reasons.append(f"no transform {self._config.frame_id} <- {frames}: {effect}")
        if self._poses.loop:
            loop = " <- ".join(self._poses.loop)
            reasons.append(f"transforms form a loop: {loop}: the shortest chain is used")
        if self._join.ignores_embeddings:
            reasons.append("no embeddings arrive: tracks are matched by motion alone")
        reasons += self._guard.reasons(self._now_ns)
        reasons += self._drift.reasons() + self._areas.neighbours.reasons(self._now_ns)
        reasons += self._hosts.reasons() + self._absence.reasons(self._now_ns)
        return Status(
            state="degraded" if reasons else "ready",
            reason="; ".join(reasons),
            counters={
                **self._counters,
                **self._guard.counters,
                **self._join.counters,
                **self._poses.counters,
                **self._areas.counters,
                **self._schedule.counters,
            },
            gauges=self._clocks.gauges(self._now_ns) | self._areas.neighbours.gauges(),
        )

    def next_number(self) -> int:
        """Return the next identity; 0 if the tracker does not save its state."""
        return self._tracker.ids.next if self._tracker.ids else 0

    def save(self) -> bytes:
        """Return tracks, identities and poses of cameras; empty before the first frame."""
        if self._last_ns is None or not self._tracker.ids:
            return b""
        checkpoint = NodeCheckpoint(
            method=self._method,
            stamp_ns=self._last_ns,
            camera_poses=self._poses.fixed,
            tracker=self._tracker.save(),
            clock_offsets_ns=self._clocks.save(),
        )
        return pack(checkpoint)

    def restore(self, saved: bytes, next_number: int) -> None:
        """Continue from a checkpoint; its identities are not reused."""
        if not self._tracker.ids:
            return
        self._tracker.ids.raise_to(next_number)
        if not saved:
            return
        checkpoint = unpack(saved, NodeCheckpoint)
        if checkpoint.method != self._method:
            raise DecodeError(f"checkpoint: expected {self._method}; got {checkpoint.method}")
        self._tracker.restore(checkpoint.tracker)
        self._poses.restore(checkpoint.camera_poses)
        self._clocks.restore(checkpoint.clock_offsets_ns, checkpoint.stamp_ns)
        self._last_ns, self._is_restored = checkpoint.stamp_ns, True

    def _add_frames(self, frames: Sequence[ArrivedFrame]) -> list[Message]:
        flushed = list[Message]()
        for frame in frames:
            detections, arrived_ns = frame.detections, frame.arrived_ns
            if self._guard.is_reset(detections):  # looped recording or restarted camera
                flushed += self._track_due(arrived_ns, flush=True)
                # Embeddings of held frames may have arrived already.
                self._join.restart(detections.camera, frames[-1].detections.stamp_ns)
                self._restart(detections, arrived_ns)
            time_ns = self._clocks.add_detections(detections, arrived_ns)
            if time_ns is None:
                self._counters["refused_cameras"] += 1
            else:
                late = self._is_too_late(time_ns)
                self._join.add_detections(detections, time_ns, arrived_ns, late)
        return flushed

    def _restart(self, detections: Detections, now_ns: int) -> None:
        self._counters["clock_resets"] += 1
        if not self._clocks.restart(detections.camera, now_ns):
            self._tracker.reset()
            self._last_ns = None
            self._schedule.clear()

    def _is_too_late(self, time_ns: int) -> bool:
        """Return True for a frame too late for the tracker to go back to."""
        late_ns = 0 if self._is_restored else LATE_MAX_NS
        return self._last_ns is not None and time_ns < self._last_ns - late_ns

    def _track_due(self, now_ns: int, flush: bool = False) -> list[Message]:
        outputs: list[Message] = []
        while frame := self._next(now_ns, flush):
            tracks = self._track(frame)
            if tracks:
                # Tracks come last: a camera in lock-step continues after them.
                in_image = self._tracker.image_tracks()
                outputs += self._output.image_tracks(frame.detections, tracks, in_image)
                outputs.append(tracks)
                self._schedule.record(frame, tracks)
        return outputs

    def _next(self, now_ns: int, flush: bool) -> PendingFrame | None:
        """Return the next frame once its odometry has arrived or timed out."""
        frame = self._held = self._held or self._join.pop(now_ns, flush)
        if frame is None:
            return None
        camera_time = frame.detections.frame_id, frame.time_ns
        is_early = not flush and now_ns < frame.arrived_ns + ODOMETRY_WAIT_NS
        if is_early and self._poses.awaits_sample(*camera_time):
            return None
        self._held = None
        return frame

    def _track(self, frame: PendingFrame) -> Tracks | None:
        with span("association"):
            observation = self._observer.observe(frame)
            if observation is None:
                return None
            self._areas.refresh(frame.time_ns, frame.arrived_ns)
            tracks = self._update_tracker(observation)
        if self._clocks.has_several:
            self._compare_cameras(observation, tracks, frame)
        trace = (frame.embeddings or frame.detections).trace
        return self._output.tracks(frame.detections, tracks, frame.time_ns, trace)

    def _update_tracker(self, observation: Observation) -> list[Track]:
        if self._last_ns is not None and observation.stamp_ns < self._last_ns:
            self._counters["late_frames"] += 1
        else:
            self._last_ns, self._is_restored = observation.stamp_ns, False
        try:
            return self._tracker.update(observation)
        except Exception:  # a faulty state would fail at every frame
            self._counters["tracker_failures"] += 1
            self._tracker.reset()
            raise

    def _compare_cameras(
        self, observation: Observation, tracks: Sequence[Track], frame: PendingFrame
    ) -> None:
        """Compare a frame with the people of other cameras."""
        self._drift.add_frame(observation, tracks)
        self._clocks.correct_stamps(self._drift, frame.time_ns)
        self._absence.add_frame(observation, tracks, frame.arrived_ns)

    def _predict_due(self, now_ns: int) -> list[Message]:
        """Return predicted tracks if detections stopped; after the last track an empty message."""
        due = self._schedule.due(now_ns)
        if due is None:
            return []
        with span("prediction"):
            ended = self._schedule.ends(now_ns)
            time_ns = max(due.time_ns, self._last_ns or due.time_ns)
            predicted = [] if ended else self._tracker.predict(time_ns)
        tracks = self._output.predicted_tracks(due, predicted)
        if not self._schedule.publishes(tracks, now_ns):
            return []
        self._counters["predictions"] += 1
        return [tracks]
