"""Publishes ground truth, stored or live, and scores tracks against it."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import msgspec

from common.geometry.transform_buffer import TransformBuffer
from common.metrics.alignment.alignment import transform_truth
from common.metrics.from_messages import plausible
from common.metrics.live import LiveScorer
from common.runtime.node import LoopCallbacks, Node, Status
from people4d.messages import (
    CameraInfo,
    Detections,
    Message,
    MovingTransform,
    Odometry,
    StaticTransform,
    Tracks,
    Truth,
)
from services.gt_bridge.alignment import EstimatedAlignment
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.playback import LEAD_NS, TruthPlayback
from services.gt_bridge.sources.registry import LiveTruthSource, ReceivedTruthSource

DEFAULT = GtBridgeConfig()
HISTORY_S = 30.0  # length of the history: ground truth may be late, and alignment looks back [s]


class GtBridgeNode(Node):
    """Publishes the truth in the configured frame, and a score for each Tracks message.

    Truth is by rising stamp, iterated anew when playback begins again; live truth has topics to be
    read instead, or is received by its source.
    """

    inputs: tuple[type[Message], ...] = (
        *(Detections, Tracks, CameraInfo),
        *(StaticTransform, MovingTransform, Odometry),
    )

    def __init__(self, truth: Iterable[Truth], config: GtBridgeConfig = DEFAULT) -> None:
        self._config = config
        self.foreign_inputs = truth.topics if isinstance(truth, LiveTruthSource) else ()
        self._received = truth if isinstance(truth, ReceivedTruthSource) else None
        self._starts = True
        self._wake: Callable[[], None] = lambda: None
        self._counters: Counter[str] = Counter()
        self._transforms = TransformBuffer(HISTORY_S)
        aligns = config.align_clock_s > 0 or config.align_space != "off"
        alignment = EstimatedAlignment(config, self._transforms) if aligns else None
        self._scorer = LiveScorer(self._transforms, self._counters, config.gate_m, alignment)
        self._playback = TruthPlayback(config, truth, self._counters, self._score_against)
        self._sequence = 0
        self._live_ns: int | None = None
        self._unlinked = ""  # frame of the last truth without a transform to the configured frame
        for transform in config.transforms:
            self._transforms.add_transform(transform.message())

    def attach(self, loop: LoopCallbacks) -> None:
        """Take the callbacks of the loop."""
        self._wake = loop.wake

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Take a message; frames pull stored truth, and tracks are scored."""
        outputs: list[Message] = []
        if isinstance(message, Detections):
            if self._playback.restarts(message.stamp_ns):
                self._scorer.restart(message.stamp_ns)
            outputs += self._publish(self._playback.up_to(message.stamp_ns))
        elif isinstance(message, Tracks):
            self._scorer.add_tracks(message)
        elif isinstance(message, Truth):
            outputs += self._publish(self._captured(message))
        elif isinstance(message, CameraInfo):
            self._scorer.views.add(message)
        elif isinstance(message, StaticTransform | MovingTransform | Odometry):
            self._transforms.add_transform(message)
        return outputs + self._scorer.due()

    def tick(self, now_ns: int) -> Sequence[Message]:
        """Return the truth that is due by the recording's own clock, or was received."""
        outputs = self._publish(self._playback.due(now_ns))
        if self._received is None:
            return outputs
        if self._starts:
            self._starts = False
            self._received.start(self._wake)
        for truth in self._received.take():
            outputs += self._publish(self._captured(truth))
        return outputs + self._scorer.due()

    def wake_ns(self) -> int | None:
        """Return the time at which the next truth is due by the recording's own clock."""
        if self._received:
            wake_s = 0.0 if self._starts else self._received.wake_s()
            return None if wake_s is None else int(wake_s * 1e9)
        return self._playback.wake_ns()

    def close(self) -> None:
        """End receiving."""
        if self._received:
            self._received.close()

    def is_finished(self) -> bool:
        """Check that all truth of a file is published, and none comes from elsewhere."""
        is_file = not self.foreign_inputs and not self._received
        return is_file and self._playback.finished and not self._playback.problem

    def status(self) -> Status:
        """Return state, reason and counters for the heartbeat."""
        counters = dict(self._counters)
        if self._received:
            counters |= self._received.counters
        if self._playback.problem:
            return Status(state="degraded", reason=self._playback.problem, counters=counters)
        if self._received and self._received.problem:
            return Status(state="degraded", reason=self._received.problem, counters=counters)
        if self.is_finished():
            return Status(state="finished", reason="all truth is published", counters=counters)
        if self._unlinked:
            reason = (
                f"no transform {self._config.frame_id} <- {self._unlinked}: "
                "the truth stays in its own frame; set transforms"
            )
            return Status(state="degraded", reason=reason, counters=counters)
        return Status(reason=self._idle_reason(), counters=counters)

    def _idle_reason(self) -> str:
        """Return the reason for which there is no truth, empty if there is some."""
        if self.foreign_inputs:
            return "" if self._live_ns is not None else f"waits for {self.foreign_inputs[0].key}"
        empty = self._playback.empty and not self._received
        return "there is no truth" if empty else ""

    def _score_against(self, truth: Truth) -> Truth:
        """Pass truth to the scorer, and return it as it is to be published, in its own frame."""
        people = plausible(truth.people)
        if len(people) < len(truth.people):
            self._counters["too_far"] += len(truth.people) - len(people)
        frame_id = self._config.truth_frame or truth.frame_id
        truth = msgspec.structs.replace(truth, frame_id=frame_id, people=people)
        self._scorer.add_truth(truth)
        return truth

    def _captured(self, truth: Truth) -> list[Truth]:
        """Return live truth, unless a newer message came before it."""
        stamp_ns = truth.stamp_ns + round(self._config.offset_s * 1e9)
        before_ns, truth = self._live_ns, msgspec.structs.replace(truth, stamp_ns=stamp_ns)
        if before_ns is not None and before_ns - LEAD_NS < stamp_ns <= before_ns:
            self._counters["late_truth"] += 1
            return []
        self._live_ns = stamp_ns
        return [self._score_against(truth)]

    def _publish(self, messages: Iterable[Truth]) -> list[Message]:
        return [self._output(truth) for truth in messages]

    def _output(self, truth: Truth) -> Truth:
        """Bring truth to the configured frame if it is linked, and number it."""
        target = self._config.frame_id
        pose = self._transforms.lookup(target, truth.frame_id, truth.stamp_ns)
        self._unlinked = "" if pose is not None else truth.frame_id
        if pose is None:
            self._counters["unlinked"] += 1
        elif target != truth.frame_id:
            truth = transform_truth(truth, pose.matrix, target)
        self._sequence += 1
        return msgspec.structs.replace(truth, sequence=self._sequence - 1)
