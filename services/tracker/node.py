"""Detections and embeddings in, tracks out."""

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import ClassVar

from common.runtime.node import StatefulNode, Status
from common.transport.trace import span
from people4d.errors import DecodeError
from people4d.messages import (
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
from services.tracker.config import TrackerConfig
from services.tracker.interface import InImage, Lasting, Need, Tracker
from services.tracker.join import Frame, Join, Patience
from services.tracker.observe import edges, observe
from services.tracker.placing import Places
from services.tracker.state import Memory, pack, unpack

PLACING = StaticTransform | MovingTransform | Odometry
SLOW_FACTOR = 3  # usual intervals between frames after which detections count as stopped
COUNTERS = (
    *("no_transform", "predicted_base", "clock_resets", "transform_changes", "predictions"),
    *("without_position", "out_of_range", "empty_boxes", "bad_embeddings"),
)


@dataclass(frozen=True, slots=True)
class _Last:
    """The last frame tracked, from which predictions go on."""

    detections: Detections
    arrived_ns: int  # [ns] monotonic


class TrackerNode(StatefulNode):
    """Joins the streams by camera and stamp, and tracks in one fixed frame.

    Every Detections is answered by one Tracks of the same stamp, but for counted drops: `stale`
    (older than what was tracked), `duplicates` (done by two detectors) and `no_transform`. When
    detections stop, predictions are published until the tracks end; the tracker itself does not
    change by them.

    Args:
        config: The configuration.
        tracker: The tracking method.
    """

    inputs: ClassVar[tuple[type[Message], ...]] = (
        *(Detections, Embeddings),
        *(CameraInfo, StaticTransform, MovingTransform, Odometry),
    )
    required_inputs: ClassVar[tuple[type[Message], ...]] = (Detections,)

    def __init__(self, config: TrackerConfig, tracker: Tracker) -> None:
        self._config = config
        self._tracker = tracker
        self._joins = Need.EMBEDDINGS in tracker.needs
        reorder_s = config.reorder_wait_s
        self._join = Join(
            Patience(
                embedding_ns=int(config.embedding_wait_s * 1e9) if self._joins else 0,
                embedding_frames=config.embedding_patience,
                reorder_ns=None if reorder_s is None else int(reorder_s * 1e9),
            )
        )
        self._places = Places(config.frame_id, config.base, config.require_transform)
        self._edges: dict[str, tuple[float, float]] = {}  # by camera, see Observation
        self._held: Frame | None = None  # its odometry has yet to come
        self._last: _Last | None = None
        self._last_of_camera: dict[str, int] = {}
        self._intervals_ns: deque[int] = deque(maxlen=9)
        self._restored_ns: int | None = None  # stamp of the last frame of another process
        self._predict_ns: int | None = None
        self._showing = False
        self._counters = Counter(dict.fromkeys(COUNTERS, 0))

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Take one message and return the tracks that follow from it."""
        flushed: list[Message] = []
        if isinstance(message, Detections):
            flushed = self._take_detections(message, now_ns)
        elif isinstance(message, Embeddings) and self._joins:
            self._join.add_embeddings(message, late=self._is_late(message))
        elif isinstance(message, CameraInfo):
            self._edges[message.camera] = edges(message)
        elif isinstance(message, PLACING) and self._places.add(message):
            # The people tracked so far stand where the camera was thought to be.
            self._counters["transform_changes"] += 1
            self._tracker.reset()
        return [*flushed, *self._track_due(now_ns)]

    def tick(self, now_ns: int) -> Sequence[Message]:
        """Return tracks of frames that have waited long enough, and predictions."""
        return self._track_due(now_ns) or self._predict_due(now_ns)

    def flush(self, now_ns: int) -> Sequence[Message]:
        """Return tracks of frames that still wait for more: nothing comes any more."""
        return self._track_due(now_ns, flush=True)

    def wake_ns(self) -> int | None:
        """Return when a frame has waited long enough or a prediction is due."""
        if self._held:
            return self._held_until_ns(self._held)
        return self._join.wake_ns() if self._join.waiting else self._predict_ns

    def status(self) -> Status:
        """Tell what is missing and what was counted."""
        reasons = []
        if self._places.unplaced:
            frames = ", ".join(sorted(self._places.unplaced))
            dropped = self._config.require_transform
            what = "frames are dropped" if dropped else "the camera is taken as the origin"
            reasons.append(f"no transform {self._config.frame_id} <- {frames}: {what}")
        if self._join.silent:
            reasons.append("no embeddings come: people are matched by motion alone")
        return Status(
            state="degraded" if reasons else "ready",
            reason="; ".join(reasons),
            counters={**self._counters, **self._join.counters, **self._places.counters},
        )

    def next_number(self) -> int:
        """Return the next identity to be given; 0 if the tracker does not tell."""
        return self._tracker.identities.next if isinstance(self._tracker, Lasting) else 0

    def save(self) -> bytes:
        """Return people, identities and where the cameras stand; empty if nothing is known yet."""
        stamp_ns = self._last.detections.stamp_ns if self._last else self._restored_ns
        if stamp_ns is None or not isinstance(self._tracker, Lasting):
            return b""
        memory = Memory(
            frame_id=self._config.frame_id,
            stamp_ns=stamp_ns,
            transforms=self._places.fixed,
            people=self._tracker.save(),
        )
        return pack(memory)

    def restore(self, saved: bytes, next_number: int) -> None:
        """Go on with what another process saved; its identities are not given again."""
        if not isinstance(self._tracker, Lasting):
            return
        self._tracker.identities.raise_to(next_number)
        if not saved:
            return
        memory = unpack(saved, Memory)
        if memory.frame_id != self._config.frame_id:
            raise DecodeError(f"what the tracker kept is in {memory.frame_id}")
        self._tracker.restore(memory.people)
        self._places.remember(memory.transforms)
        self._restored_ns = memory.stamp_ns

    def _take_detections(self, detections: Detections, now_ns: int) -> list[Message]:
        stamp_ns, flushed = detections.stamp_ns, list[Message]()
        newest_ns = self._join.newest_ns(detections.camera)
        newest_ns = self._restored_ns if newest_ns is None else newest_ns
        if newest_ns is not None and newest_ns - stamp_ns > self._config.clock_jump_s * 1e9:
            flushed = self._track_due(now_ns, flush=True)
            self._restart(stamp_ns)
        self._join.add_detections(detections, now_ns, late=self._is_stale(detections))
        return flushed

    def _restart(self, stamp_ns: int) -> None:
        """Begin anew after a clock went back: a recording looped, or a camera was restarted."""
        self._counters["clock_resets"] += 1
        self._tracker.reset()
        self._join.restart(stamp_ns)
        self._last, self._restored_ns, self._predict_ns = None, None, None
        self._last_of_camera.clear()
        self._intervals_ns.clear()

    def _is_stale(self, detections: Detections) -> bool:
        newest_ns = self._last.detections.stamp_ns if self._last else self._restored_ns
        if newest_ns is not None and detections.stamp_ns < newest_ns:
            return True
        last_ns = self._last_of_camera.get(detections.camera)
        return last_ns is not None and detections.stamp_ns <= last_ns

    def _is_late(self, embeddings: Embeddings) -> bool:
        last_ns = self._last_of_camera.get(embeddings.camera)
        if last_ns is None:
            return False
        # Far behind is not late but the first of a time that begins anew.
        return 0 <= last_ns - embeddings.stamp_ns <= self._config.clock_jump_s * 1e9

    def _track_due(self, now_ns: int, flush: bool = False) -> list[Message]:
        outputs: list[Message] = []
        while frame := self._next(now_ns, flush):
            tracks = self._track(frame)
            if tracks:
                # A camera in lock-step goes on at the tracks: they come last.
                outputs += [*self._in_image(frame.detections, tracks), tracks]
                self._remember(frame)
        return outputs

    def _next(self, now_ns: int, flush: bool) -> Frame | None:
        """Take the next frame once the odometry of its time is there, or waited for in vain."""
        frame = self._held = self._held or self._join.pop(now_ns, flush)
        if frame is None:
            return None
        wanted = frame.detections.frame_id, frame.detections.stamp_ns
        is_early = not flush and now_ns < self._held_until_ns(frame)
        if is_early and self._places.waits(*wanted):
            return None
        self._held = None
        return frame

    def _held_until_ns(self, frame: Frame) -> int:
        return frame.arrived_ns + int(self._config.odometry_wait_s * 1e9)

    def _track(self, frame: Frame) -> Tracks | None:
        detections, embeddings = frame.detections, frame.embeddings
        place = self._places.find(detections.frame_id, detections.stamp_ns)
        if place is None:
            self._counters["no_transform"] += 1
            return None
        self._counters["predicted_base"] += place.is_uncertain
        with span("association"):
            observation = observe(
                detections, embeddings, place, self._config.max_range_m, self._counters
            )
            observation = replace(observation, edges=self._edges.get(detections.camera))
            self._bridge_absence(observation.stamp_ns)
            people = self._tracker.update(observation)
        return self._publish(detections, people, (embeddings or detections).trace)

    def _bridge_absence(self, stamp_ns: int) -> None:
        """Let most of a time pass unnoticed in which no frame came, or no process of this name ran.

        After a short one people are where they were going, after a long one only who stayed is
        found: nobody looked, so nobody was missed.
        """
        last_ns = self._last.detections.stamp_ns if self._last else self._restored_ns
        if last_ns is None or not isinstance(self._tracker, Lasting):
            return
        config, absent_s = self._config, (stamp_ns - last_ns) / 1e9
        if config.max_lost_s < absent_s <= config.absence_max_s:
            self._tracker.postpone(int((absent_s - config.absence_moved_s) * 1e9))

    def _remember(self, frame: Frame) -> None:
        if self._last:
            self._intervals_ns.append(frame.arrived_ns - self._last.arrived_ns)
        self._last, self._restored_ns = _Last(frame.detections, frame.arrived_ns), None
        self._last_of_camera[frame.detections.camera] = frame.detections.stamp_ns
        # A playback slower than real time is no outage: wait longer where frames come slowly.
        usual_ns = median(self._intervals_ns) if self._intervals_ns else 0
        quiet_ns = max(self._config.predict_after_s * 1e9, SLOW_FACTOR * usual_ns)
        self._predict_ns = frame.arrived_ns + int(quiet_ns)

    def _predict_due(self, now_ns: int) -> list[Message]:
        """Return predicted tracks if detections stopped; after the last track one empty message."""
        last = self._last
        if last is None or self._predict_ns is None or now_ns < self._predict_ns:
            return []
        was_showing = self._showing
        stamp_ns = last.detections.stamp_ns + now_ns - last.arrived_ns
        with span("prediction"):
            people = self._tracker.predict(stamp_ns)
        tracks = self._publish(last.detections, people, (), stamp_ns)
        if not was_showing and not tracks.tracks:
            self._predict_ns = None
            return []
        self._predict_ns = now_ns + int(1e9 / self._config.predict_hz)
        self._counters["predictions"] += 1
        return [tracks]

    def _publish(
        self,
        detections: Detections,
        people: Sequence[Track],
        trace: tuple[Span, ...],
        stamp_ns: int | None = None,
    ) -> Tracks:
        stamp_ns = detections.stamp_ns if stamp_ns is None else stamp_ns
        people = self._places.told(people, stamp_ns)
        chosen = tuple(track for track in people if self._is_shown(track))
        self._showing = bool(chosen)
        return Tracks(
            stamp_ns=stamp_ns,
            sequence=detections.sequence,
            trace=trace,
            frame_id=self._config.frame_id,
            tracker=self._config.tracker,
            camera=detections.camera,
            tracks=chosen,
        )

    def _in_image(self, detections: Detections, tracks: Tracks) -> list[Message]:
        """Return the people in the image, if the tracker follows them there."""
        if not isinstance(self._tracker, InImage):
            return []
        told = ImageTracks(
            stamp_ns=tracks.stamp_ns,
            sequence=tracks.sequence,
            trace=tracks.trace,
            camera=tracks.camera,
            tracker=tracks.tracker,
            width=detections.width,
            height=detections.height,
            tracks=tuple(track for track in self._tracker.in_image() if self._is_shown(track)),
        )
        return [told]

    def _is_shown(self, track: Track | ImageTrack) -> bool:
        config = self._config
        told = {"tentative": config.publish_tentative, "lost": config.publish_lost}
        return told.get(track.state, True)
