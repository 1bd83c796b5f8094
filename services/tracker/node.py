"""Node of the tracker: detections and embeddings in, tracks out."""

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import replace
from statistics import median
from typing import ClassVar

import msgspec

from common.runtime.node import StatefulNode, Status
from common.transport.trace import span
from people4d.errors import DecodeError
from people4d.messages import (
    F64,
    CameraInfo,
    Detections,
    Embeddings,
    ImageTrack,
    ImageTracks,
    Message,
    MovingTransform,
    Odometry,
    Span,
    StaticTransform,
    Track,
    Tracks,
)
from services.tracker.camera_poses import CameraPoseLookup
from services.tracker.config import TrackerConfig
from services.tracker.frame_join import FrameJoin, PendingFrame
from services.tracker.interface import Tracker
from services.tracker.observe import edges, observe
from services.tracker.stateful import pack, unpack

TRANSFORMS = StaticTransform | MovingTransform | Odometry
SLOW_FACTOR = 3  # usual intervals between frames after which detections count as stopped
COUNTERS = (
    *("no_transform", "predicted_base", "clock_resets", "transform_changes", "predictions"),
    *("without_position", "out_of_range", "empty_boxes", "bad_embeddings"),
)


class NodeCheckpoint(msgspec.Struct, frozen=True, kw_only=True):
    """The state of the service."""

    frame_id: str  # frame of the tracks
    stamp_ns: int  # [ns] of the last frame tracked
    camera_poses: dict[str, F64]  # 4x4 by optical frame, of fixed cameras
    tracker: bytes  # its own checkpoint


class TrackerNode(StatefulNode):
    """Joins the streams by camera and stamp, and tracks in one fixed frame.

    Every Detections is answered by one Tracks of the same stamp, but for counted drops: `stale`
    (older than the last frame tracked), `duplicates` (of two detectors) and `no_transform`. When
    detections stop, predictions are published until the tracks end; the tracker itself does not
    change by them.
    """

    inputs: ClassVar[tuple[type[Message], ...]] = (
        *(Detections, Embeddings),
        *(CameraInfo, StaticTransform, MovingTransform, Odometry),
    )
    required_inputs: ClassVar[tuple[type[Message], ...]] = (Detections,)

    def __init__(self, config: TrackerConfig, tracker: Tracker) -> None:
        self._config = config
        self._tracker = tracker
        self._join = FrameJoin(config, tracker.uses_embeddings)
        self._poses = CameraPoseLookup(config.frame_id, config.base, config.require_transform)
        self._edges: dict[str, tuple[float, float]] = {}  # by camera, see Observation
        self._held: PendingFrame | None = None  # waits for the odometry of its time
        self._last: PendingFrame | None = None  # the last frame tracked
        self._last_of_camera: dict[str, int] = {}
        self._intervals_ns: deque[int] = deque(maxlen=9)
        self._restored_ns: int | None = None  # stamp of the last frame of another process
        self._predict_ns: int | None = None
        self._has_published = False
        self._counters = Counter(dict.fromkeys(COUNTERS, 0))

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Process one message and return the tracks that follow from it."""
        flushed: list[Message] = []
        if isinstance(message, Detections):
            flushed = self._add_detections(message, now_ns)
        elif isinstance(message, Embeddings) and self._tracker.uses_embeddings:
            self._join.add_embeddings(message, late=self._is_late(message))
        elif isinstance(message, CameraInfo):
            self._edges[message.camera] = edges(message)
        elif isinstance(message, TRANSFORMS) and self._poses.add(message):
            # The tracks are relative to the former pose of the camera.
            self._counters["transform_changes"] += 1
            self._tracker.reset()
        return [*flushed, *self._track_due(now_ns)]

    def tick(self, now_ns: int) -> Sequence[Message]:
        """Return tracks of frames that have waited long enough, and predictions."""
        return self._track_due(now_ns) or self._predict_due(now_ns)

    def flush(self, now_ns: int) -> Sequence[Message]:
        """Return tracks of all frames that wait."""
        return self._track_due(now_ns, flush=True)

    def wake_ns(self) -> int | None:
        """Return the time at which a frame has waited long enough or a prediction is due."""
        if self._held:
            return self._held_until_ns(self._held)
        return self._join.wake_ns() if self._join.waiting else self._predict_ns

    def status(self) -> Status:
        """Report missing inputs and counters."""
        reasons = []
        if self._poses.without_transform:
            frames = ", ".join(sorted(self._poses.without_transform))
            dropped = self._config.require_transform
            effect = "frames are dropped" if dropped else "the camera is taken as the origin"
            reasons.append(f"no transform {self._config.frame_id} <- {frames}: {effect}")
        if self._join.ignores_embeddings:
            reasons.append("no embeddings arrive: tracks are matched by motion alone")
        return Status(
            state="degraded" if reasons else "ready",
            reason="; ".join(reasons),
            counters={**self._counters, **self._join.counters, **self._poses.counters},
        )

    def next_number(self) -> int:
        """Return the next identity to be given; 0 if the tracker does not save its state."""
        return self._tracker.ids.next if self._tracker.ids else 0

    def save(self) -> bytes:
        """Return tracks, identities and poses of cameras; empty before the first frame."""
        stamp_ns = self._last_ns()
        if stamp_ns is None or not self._tracker.ids:
            return b""
        checkpoint = NodeCheckpoint(
            frame_id=self._config.frame_id,
            stamp_ns=stamp_ns,
            camera_poses=self._poses.fixed,
            tracker=self._tracker.save(),
        )
        return pack(checkpoint)

    def restore(self, saved: bytes, next_number: int) -> None:
        """Continue from a checkpoint; its identities are not given again."""
        if not self._tracker.ids:
            return
        self._tracker.ids.raise_to(next_number)
        if not saved:
            return
        checkpoint = unpack(saved, NodeCheckpoint)
        if checkpoint.frame_id != self._config.frame_id:
            raise DecodeError(f"checkpoint: tracks are in {checkpoint.frame_id}")
        self._tracker.restore(checkpoint.tracker)
        self._poses.restore(checkpoint.camera_poses)
        self._restored_ns = checkpoint.stamp_ns

    def _add_detections(self, detections: Detections, now_ns: int) -> list[Message]:
        stamp_ns, flushed = detections.stamp_ns, list[Message]()
        newest_ns = self._join.newest_ns(detections.camera)
        newest_ns = self._restored_ns if newest_ns is None else newest_ns
        if newest_ns is not None and newest_ns - stamp_ns > self._config.clock_jump_s * 1e9:
            flushed = self._track_due(now_ns, flush=True)
            self._restart(stamp_ns)
        self._join.add_detections(detections, now_ns, late=self._is_stale(detections))
        return flushed

    def _restart(self, stamp_ns: int) -> None:
        """Restart after a clock reset: a recording looped, or a camera was restarted."""
        self._counters["clock_resets"] += 1
        self._tracker.reset()
        self._join.restart(stamp_ns)
        self._last, self._restored_ns, self._predict_ns = None, None, None
        self._last_of_camera.clear()
        self._intervals_ns.clear()

    def _last_ns(self) -> int | None:
        """Return the stamp of the last frame tracked, by this process or the one before."""
        return self._last.detections.stamp_ns if self._last else self._restored_ns

    def _is_stale(self, detections: Detections) -> bool:
        newest_ns = self._last_ns()
        if newest_ns is not None and detections.stamp_ns < newest_ns:
            return True
        last_ns = self._last_of_camera.get(detections.camera)
        return last_ns is not None and detections.stamp_ns <= last_ns

    def _is_late(self, embeddings: Embeddings) -> bool:
        last_ns = self._last_of_camera.get(embeddings.camera)
        if last_ns is None:
            return False
        # Far behind is not late but the first after a clock reset.
        return 0 <= last_ns - embeddings.stamp_ns <= self._config.clock_jump_s * 1e9

    def _track_due(self, now_ns: int, flush: bool = False) -> list[Message]:
        outputs: list[Message] = []
        while frame := self._next(now_ns, flush):
            tracks = self._track(frame)
            if tracks:
                # A camera in lock-step continues at the tracks: they come last.
                outputs += [*self._image_tracks(frame.detections, tracks), tracks]
                self._record(frame)
        return outputs

    def _next(self, now_ns: int, flush: bool) -> PendingFrame | None:
        """Return the next frame once the odometry of its time has arrived or timed out."""
        frame = self._held = self._held or self._join.pop(now_ns, flush)
        if frame is None:
            return None
        camera_time = frame.detections.frame_id, frame.detections.stamp_ns
        is_early = not flush and now_ns < self._held_until_ns(frame)
        if is_early and self._poses.awaits_sample(*camera_time):
            return None
        self._held = None
        return frame

    def _held_until_ns(self, frame: PendingFrame) -> int:
        return frame.arrived_ns + int(self._config.odometry_wait_s * 1e9)

    def _track(self, frame: PendingFrame) -> Tracks | None:
        detections, embeddings = frame.detections, frame.embeddings
        pose = self._poses.lookup(detections.frame_id, detections.stamp_ns)
        if pose is None:
            self._counters["no_transform"] += 1
            return None
        self._counters["predicted_base"] += pose.is_uncertain
        with span("association"):
            observation = observe(
                detections, embeddings, pose, self._config.max_range_m, self._counters
            )
            observation = replace(observation, edges=self._edges.get(detections.camera))
            self._bridge_absence(observation.stamp_ns)
            tracks = self._tracker.update(observation)
        return self._publish(detections, tracks, (embeddings or detections).trace)

    def _bridge_absence(self, stamp_ns: int) -> None:
        """Skip most of a time in which no frame came, or this service did not run.

        After a short one people are found where they were going, after a long one where they were.
        """
        last_ns = self._last_ns()
        if last_ns is None:
            return
        config, absent_s = self._config, (stamp_ns - last_ns) / 1e9
        if config.max_lost_s < absent_s <= config.absence_max_s:
            self._tracker.postpone(int((absent_s - config.absence_moved_s) * 1e9))

    def _record(self, frame: PendingFrame) -> None:
        if self._last:
            self._intervals_ns.append(frame.arrived_ns - self._last.arrived_ns)
        self._last, self._restored_ns = frame, None
        self._last_of_camera[frame.detections.camera] = frame.detections.stamp_ns
        # A playback slower than real time is no outage: wait longer where frames are slow.
        period_ns = median(self._intervals_ns) if self._intervals_ns else 0
        quiet_ns = max(self._config.predict_after_s * 1e9, SLOW_FACTOR * period_ns)
        self._predict_ns = frame.arrived_ns + int(quiet_ns)

    def _predict_due(self, now_ns: int) -> list[Message]:
        """Return predicted tracks if detections stopped; after the last track an empty message."""
        last = self._last
        if last is None or self._predict_ns is None or now_ns < self._predict_ns:
            return []
        had_tracks = self._has_published
        stamp_ns = last.detections.stamp_ns + now_ns - last.arrived_ns
        with span("prediction"):
            predicted = self._tracker.predict(stamp_ns)
        tracks = self._publish(last.detections, predicted, (), stamp_ns)
        if not had_tracks and not tracks.tracks:
            self._predict_ns = None
            return []
        self._predict_ns = now_ns + int(1e9 / self._config.predict_hz)
        self._counters["predictions"] += 1
        return [tracks]

    def _publish(
        self,
        detections: Detections,
        tracks: Sequence[Track],
        trace: tuple[Span, ...],
        stamp_ns: int | None = None,
    ) -> Tracks:
        stamp_ns = detections.stamp_ns if stamp_ns is None else stamp_ns
        tracks = self._poses.to_output_frame(tracks, stamp_ns)
        published = tuple(track for track in tracks if self._is_published(track))
        self._has_published = bool(published)
        return Tracks(
            stamp_ns=stamp_ns,
            sequence=detections.sequence,
            trace=trace,
            frame_id=self._config.frame_id,
            tracker=self._config.tracker,
            camera=detections.camera,
            tracks=published,
        )

    def _image_tracks(self, detections: Detections, tracks: Tracks) -> list[Message]:
        image_tracks = self._tracker.image_tracks()
        if image_tracks is None:
            return []
        message = ImageTracks(
            stamp_ns=tracks.stamp_ns,
            sequence=tracks.sequence,
            trace=tracks.trace,
            camera=tracks.camera,
            tracker=tracks.tracker,
            width=detections.width,
            height=detections.height,
            tracks=tuple(track for track in image_tracks if self._is_published(track)),
        )
        return [message]

    def _is_published(self, track: Track | ImageTrack) -> bool:
        config = self._config
        published = {"tentative": config.publish_tentative, "lost": config.publish_lost}
        return published.get(track.state, True)
