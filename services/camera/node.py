"""The camera: frames from a source, live, as recorded or in lockstep."""

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

import msgspec

from common.calibration.transforms_file import MAP, read_pose
from common.diagnosis.event_table import REJECTED
from common.io.images import compress
from common.ros2.frame_names import OPTICAL_FRAME
from common.runtime.node import LoopCallbacks, Node, Status
from common.transport.trace import record, span
from people4d.errors import SourceError
from people4d.messages import CameraInfo, Detections, Message, RgbdFrame, StaticTransform, Tracks
from people4d.topics import ForeignTopic
from services.camera.calibration import renamed, static_transform
from services.camera.config import CameraConfig
from services.camera.frame_check import FrameCheck
from services.camera.pacing import RecordedPacing, SourceRate, is_jump, pacing_of
from services.camera.playback import play
from services.camera.prefetch import Prefetch, PrefetchedItem
from services.camera.source import Source, SourceFrame, SourceItem, SourceSetup
from services.camera.upright import (
    quarter_turns,
    turned_image,
    turned_info,
    turned_transforms,
    turns_of,
)

if TYPE_CHECKING:
    from services.camera.ros.live_motion import LiveMotion

FRAMES_AHEAD = 4  # number of frames read ahead
POLL_NS = 2_000_000  # [ns] period of polling without a loop
STOP_S = 2.0  # [s] maximum wait for the reading thread
STILL_FRAMES = 10  # number of frames of one stamp that are reported
MAX_AGE_NS = 1_000_000_000  # [ns] maximum age of a live frame whose stamp comes from this clock

ANSWERS: dict[str, type[Message]] = {"people": Tracks, "detections": Detections}


class CameraNode(Node):
    """Publishes calibration and transform once, then frames and odometry; closes its source.

    A thread reads and decodes ahead and wakes the loop; without a loop, `wake_ns` polls every 2 ms.
    ConfigError if the playback does not suit the source.
    """

    periodic_outputs: ClassVar[tuple[type[Message], ...]] = (RgbdFrame,)

    def __init__(self, config: CameraConfig, source: Source) -> None:
        self._config = config
        self._source = source
        self._lockstep = config.playback == "lockstep"
        self.inputs = (ANSWERS[config.answer],) if self._lockstep else ()
        self._pacing = pacing_of(config, source.live)
        self._info: CameraInfo | None = None
        self._turns = 0  # number of clockwise quarter turns of the images
        self._transforms: Sequence[StaticTransform] = ()
        self._motion = _motion(config)
        self.foreign_inputs: Sequence[ForeignTopic] = self._motion.topics if self._motion else ()
        info = None if source.calibrates_late else source.info
        self._check = FrameCheck(info, source.depth_in_metres)
        self._prefetch = Prefetch(
            lambda: play(source, config, self._accept), FRAMES_AHEAD, source.live
        )
        self._wake: Callable[[], None] | None = None
        self._begin_ns: int | None = None  # [ns] monotonic time of the first frame
        self._tick_ns = 0
        self._stamp_ns: int | None = None
        self._still = 0  # number of frames since the stamp changed
        self._sequence = 0
        self._to_compress: RgbdFrame | None = None  # frame to be sent compressed in the next tick
        self._next_compressed_ns = 0
        self._unanswered = False  # True if frames timed out since the last answer
        self._rate = SourceRate(config.speed) if isinstance(self._pacing, RecordedPacing) else None
        self._behind_s = 0.0  # [s] delay of a live camera's stamps behind the clock of its host
        self._counters: Counter[str] = Counter()

    def attach(self, loop: LoopCallbacks) -> None:
        """Store the callbacks of the loop."""
        self._wake = loop.wake

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Register an answer, after which `tick` sends the next frame; forward motion."""
        if self._motion and not isinstance(message, Tracks | Detections):
            own = [self._info.frame_id] if self._info else []
            return self._motion.convert(message, [*own, *(t.parent for t in self._transforms)])
        if (
            isinstance(message, Tracks | Detections)
            and isinstance(message, self.inputs)
            and self._info
            and message.camera == self._info.camera
        ):
            self._pacing.answered(message.stamp_ns)
            self._unanswered = False
        return ()

    def tick(self, now_ns: int) -> Sequence[Message]:
        """Return calibration first, then the frames and odometry that are due."""
        self._tick_ns = now_ns
        if self._begin_ns is None:
            # A live camera soon repeats data that early subscribers missed.
            delay_s = 0.0 if self._source.live else self._config.start_delay_s
            self._begin_ns = now_ns + int(delay_s * 1e9)
            self._prefetch.start(self._wake or (lambda: None))
            if self._source.calibrates_late:
                return []
            source = self._source
            return self._calibrate(source.info, source.transforms, source.moves)
        given_up = self._pacing.give_up(now_ns)
        self._unanswered = self._unanswered or given_up > 0
        self._counters["unanswered"] += given_up
        outputs: list[Message] = []
        # One frame a tick, so each has its own time of sending.
        while self._is_due(now_ns) and not any(isinstance(m, RgbdFrame) for m in outputs):
            outputs += self._message(self._prefetch.next_item(), now_ns)
        if not outputs and self._to_compress:  # in a separate tick, which delays no frame
            outputs = [compress(self._to_compress)]
            self._to_compress = None
        return outputs

    def wake_ns(self) -> int | None:
        """Return the time of the next frame, or the deadline of an answer."""
        if self._begin_ns is None:
            return self._tick_ns
        if self._tick_ns < self._begin_ns:
            return self._begin_ns
        if self._to_compress:
            return self._tick_ns
        times = [self._pacing.wake_ns()]
        item = self._prefetch.peek()
        if item is not None:
            times.append(self._pacing.due_ns(item.stamp_ns, self._tick_ns))
        elif not self._wake and not self._prefetch.ended:
            times.append(self._tick_ns + POLL_NS)
        return min((time_ns for time_ns in times if time_ns is not None), default=None)

    def is_finished(self) -> bool:
        """Check that the source has ended and its frames are sent, or that no frame is usable."""
        if self._check.hopeless:
            return True
        # In this order, so an item put before the end is not missed.
        ended = self._prefetch.ended
        return ended and self._prefetch.peek() is None and self._pacing.wake_ns() is None

    def status(self) -> Status:
        """Return the state of the source, and the drops by cause."""
        counters = Counter(self._source.counters) + self._counters
        counters += Counter(self._check.counters)
        counters += Counter(self._motion.counters if self._motion else {})
        counters += Counter(source_errors=self._prefetch.errors, skipped=self._prefetch.skipped)
        reason = self._prefetch.reason or self._source.problem or self._check.fault
        if self._still >= STILL_FRAMES and not reason:
            reason = "the stamps of its frames stand still. Give each frame its time of acquisition"
        if self._unanswered and not reason:
            reason = f"frames get no answer on {self._config.answer}"
        if self._motion and self._motion.silent and self._sequence and not reason:
            reason = f"no messages on {', '.join(self._motion.silent)}"
        if self.is_finished():
            if counters["cut_short"]:
                reason = reason or "the recording is cut short and was played up to there"
            if not self._sequence:
                dropped = ", ".join(f"{name} {count}" for name, count in counters.items() if count)
                reason = reason or "the source had no frame that could be played"
                reason += f" ({dropped})" if dropped else ""
            return Status(state="finished", reason=reason, counters=counters)
        gauges = {"stamps_behind_s": self._behind_s} if self._source.live else {}
        if self._rate and self._rate.is_slow and not reason:
            gauges |= {"source_hz": self._rate.hz, "source_wanted_hz": self._rate.wanted_hz}
            reason = f"its source gives {self._rate.hz:.1f} of {self._rate.wanted_hz:.1f} Hz"
        if reason and (self._sequence or not self._check.fault):
            return Status(state="degraded", reason=reason, counters=counters, gauges=gauges)
        state: Literal["ready", "starting"] = "ready" if self._sequence else "starting"
        return Status(state=state, reason=reason, counters=counters, gauges=gauges)

    def close(self) -> None:
        """Stop and close the source; SourceError if no frame of it matches its declaration."""
        check = self._check
        cause, fault = (check.cause, check.fault) if check.hopeless else ("", "")
        self._source.interrupt()
        self._prefetch.stop(STOP_S)
        self._source.close()
        if fault:
            raise SourceError(f"no frame of the source can be used: {fault}", REJECTED[cause])

    def _accept(self, item: SourceItem) -> SourceItem | None:
        """Check an item in the reading thread; after a stop all items pass, so the thread ends."""
        return item if self._prefetch.stopped else self._check.accept(item)

    def _is_due(self, now_ns: int) -> bool:
        item = self._prefetch.peek()
        if item is None or now_ns < (self._begin_ns or 0):
            return False
        if not isinstance(item, SourceFrame):
            return True  # motion is sent with the previous frame; consumers join it by stamp
        due_ns = self._pacing.due_ns(item.stamp_ns, now_ns)
        return due_ns is not None and due_ns <= now_ns

    def _message(self, reading: PrefetchedItem, now_ns: int) -> list[Message]:
        item = reading.item
        if isinstance(item, SourceSetup):
            return self._calibrate(item.info, item.transforms, item.moves)
        if not isinstance(item, SourceFrame):
            return [item]
        jumped = self._stamp_ns is not None and is_jump(item.stamp_ns - self._stamp_ns)
        self._counters["stamp_jumps"] += jumped
        self._still = self._still + 1 if item.stamp_ns == self._stamp_ns else 0
        self._stamp_ns = item.stamp_ns
        if self._source.live:  # reading ahead from a file does not count as latency
            record("capture", _acquired_ns(reading, item), reading.end_ns)
            self._behind_s = (reading.end_ns - item.stamp_ns) / 1e9
        with span("release"):
            frame = self._frame(item)
        if frame is None:
            return []
        self._pacing.sent(item.stamp_ns, now_ns)
        if self._rate:
            self._rate.add_frame(item.stamp_ns, now_ns)
        self._sequence += 1
        if self._config.compressed_hz and now_ns >= self._next_compressed_ns:
            self._to_compress = frame
            self._next_compressed_ns = now_ns + int(1e9 / self._config.compressed_hz)
        return [frame]

    def _calibrate(
        self, info: CameraInfo, transforms: Sequence[StaticTransform], moves: bool
    ) -> list[Message]:
        """Store calibration and pose, and return the messages to publish."""
        named = _info(self._config, info)
        mount = self._config.mount_from_optical
        poses = [static_transform(self._config.mount_parent, named.frame_id, mount)]
        if transforms or moves:
            poses = renamed(transforms, info.frame_id, named.frame_id)
        # The roll of a pan-tilt camera differs from the roll of its mount.
        swings = moves or bool(self._config.motion.transforms)
        turns = 0 if swings else turns_of(poses, named.frame_id)
        if self._config.rotate is not None and not swings:
            turns = self._config.rotate // 90
        if self._config.transforms:
            pose = read_pose(Path(self._config.transforms), named.camera)
            of_turned = turns and not quarter_turns(pose)  # calibrated on turned images
            child = turned_info(named, turns).frame_id if of_turned else named.frame_id
            turns = quarter_turns(pose) or turns
            poses = [static_transform(MAP, child, pose)]
        self._turns, self._info = turns, turned_info(named, turns)
        self._transforms = turned_transforms(poses, named.frame_id, self._info, turns)
        return [self._info, *self._transforms]

    def _frame(self, item: SourceFrame) -> RgbdFrame | None:
        """Return the message; None before the calibration is known."""
        if self._info is None:
            return None
        return RgbdFrame(
            stamp_ns=item.stamp_ns,
            sequence=self._sequence,
            camera=self._info.camera,
            rgb=turned_image(item.rgb, self._turns),
            depth_mm=turned_image(item.depth_mm, self._turns),
            lockstep=self._lockstep,
        )


def _acquired_ns(reading: PrefetchedItem, item: SourceFrame) -> int:
    """Return the acquisition time of a live frame, or of its reading if the clocks differ."""
    age_ns = reading.end_ns - item.stamp_ns
    return item.stamp_ns if 0 <= age_ns < MAX_AGE_NS else reading.start_ns


def _motion(config: CameraConfig) -> "LiveMotion | None":
    if not config.motion.enabled:
        return None
    from services.camera.ros.live_motion import LiveMotion  # noqa: PLC0415  # has the types of ROS

    return LiveMotion(config.motion)


def _info(config: CameraConfig, info: CameraInfo) -> CameraInfo:
    camera = config.camera or info.camera
    # Two cameras without frame names must not share one.
    unnamed = info.frame_id == OPTICAL_FRAME
    return msgspec.structs.replace(
        info,
        stamp_ns=0,
        sequence=0,
        trace=(),
        camera=camera,
        frame_id=f"{camera}_optical_frame" if unnamed else info.frame_id,
        max_depth_m=config.max_depth_m or info.max_depth_m,
    )
