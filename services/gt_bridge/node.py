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
from services.gt_bridge.sources.registry import LiveTruthSource

DEFAULT = GtBridgeConfig()
HISTORY_S = 30.0  # length of the history of transforms, for late truth and alignment [s]


class GtBridgeNode(Node):
    """Publishes the truth in the configured frame, and a score for each Tracks message.

    Stored truth has rising stamps, and is iterated again when playback restarts.
    """

    inputs: tuple[type[Message], ...] = (
        *(Detections, Tracks, CameraInfo),
        *(StaticTransform, MovingTransform, Odometry),
    )

    def __init__(self, truth: Iterable[Truth], config: GtBridgeConfig = DEFAULT) -> None:
        self._config = config
        self._live = truth if isinstance(truth, LiveTruthSource) else None
        self._started = False
        self._wake: Callable[[], None] = lambda: None
        self._counters: Counter[str] = Counter()
        self._transforms = TransformBuffer(HISTORY_S)
        aligns = config.align_clock_s > 0 or config.align_space != "off"
        alignment = EstimatedAlignment(config, self._transforms) if aligns else None
        self._scorer = LiveScorer(self._transforms, self._counters, config.gate_m, alignment)
        self._playback = TruthPlayback(config, truth, self._counters, self._score_against)
        self._sequence = 0
        self._live_ns: int | None = None
        self._unlinked = ""  # frame of the last truth without a transform to the configured one
        for transform in config.transforms:
            self._transforms.add_transform(transform.message())

    def attach(self, loop: LoopCallbacks) -> None:
        """Use the callbacks of the loop."""
        self._wake = loop.wake

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Add a message: detections release stored truth up to their stamp, tracks are scored."""
        outputs: list[Message] = []
        if isinstance(message, Detections):
            if self._playback.restarts(message.stamp_ns):
                self._scorer.restart(message.stamp_ns)
            outputs += self._publish(self._playback.up_to(message.stamp_ns))
        elif isinstance(message, Tracks):
            self._scorer.add_tracks(message)
        elif isinstance(message, CameraInfo):
            self._scorer.views.add_camera(message)
        elif isinstance(message, StaticTransform | MovingTransform | Odometry):
            self._transforms.add_transform(message)
        return outputs + self._scorer.due()

    def tick(self, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Return the received live truth."""
        if self._live is None:
            return []
        if not self._started:
            self._started = True
            self._live.start(self._wake)
        outputs: list[Message] = []
        for truth in self._live.take_truth():
            outputs += self._publish(self._captured(truth))
        return outputs + self._scorer.due()

    def wake_ns(self) -> int | None:
        """Return the time at which live truth is due."""
        if self._live is None:
            return None
        wake_s = self._live.wake_s() if self._started else 0.0
        return None if wake_s is None else int(wake_s * 1e9)

    def close(self) -> None:
        """Stop receiving."""
        if self._live:
            self._live.close()

    def status(self) -> Status:
        """Return state, reason and counters for the heartbeat."""
        counters = dict(self._counters)
        if self._live:
            counters |= self._live.counters
        unlinked = (
            f"no transform {self._config.frame_id} <- {self._unlinked}: "
            "the truth stays in its own frame; set transforms"
        )
        problem = (
            self._playback.problem
            or (self._live.problem if self._live else "")
            or (unlinked if self._unlinked else "")
        )
        if problem:
            return Status(state="degraded", reason=problem, counters=counters)
        empty = self._playback.empty and not self._live
        return Status(reason="there is no truth" if empty else "", counters=counters)

    def _score_against(self, truth: Truth) -> Truth:
        """Add truth to the scorer, and return its published form in its own frame."""
        people = plausible(truth.people)
        if len(people) < len(truth.people):
            self._counters["too_far"] += len(truth.people) - len(people)
        frame_id = self._config.truth_frame or truth.frame_id
        truth = msgspec.structs.replace(truth, frame_id=frame_id, people=people)
        self._scorer.add_truth(truth)
        return truth

    def _captured(self, truth: Truth) -> list[Truth]:
        """Return live truth, unless a newer message arrived earlier."""
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
        """Number truth, and transform it to the configured frame if possible."""
        target = self._config.frame_id
        pose = self._transforms.lookup(target, truth.frame_id, truth.stamp_ns)
        self._unlinked = "" if pose is not None else truth.frame_id
        if pose is None:
            self._counters["unlinked"] += 1
        elif target != truth.frame_id:
            truth = transform_truth(truth, pose.matrix, target)
        self._sequence += 1
        return msgspec.structs.replace(truth, sequence=self._sequence - 1)
