"""Publishes truth, stored or captured now, and how far the tracks are from it."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import ClassVar

import msgspec

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transform_history import TransformBufferConfig
from common.metrics import transform_truth
from common.runtime.node import Node, Status
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
from people4d.topics import ForeignTopic
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.playback import LEAD_NS, StoredTruth
from services.gt_bridge.scoring.judge import near
from services.gt_bridge.scoring.scorer import Scorer
from services.gt_bridge.scoring.views import Views

DEFAULT = GtBridgeConfig()
MOTION = TransformBufferConfig(history_s=30.0)  # truth may come late, and alignments look back


class GtBridgeNode(Node):
    """Sends the truth in the frame that is wanted, and a score for each Tracks message.

    Args:
        truth: Messages by rising stamp, iterated anew when playback begins again; what is captured
            now has `topics` to be read instead.
        config: The configuration.
    """

    inputs: ClassVar[tuple[type[Message], ...]] = (
        *(Detections, Tracks, CameraInfo),
        *(StaticTransform, MovingTransform, Odometry),
    )

    def __init__(self, truth: Iterable[Truth], config: GtBridgeConfig = DEFAULT) -> None:
        self._config = config
        self.foreign_inputs: Sequence[ForeignTopic] = getattr(truth, "topics", ())
        self._counters: Counter[str] = Counter()
        self._frames = TransformBuffer(MOTION)
        self._views = Views(self._frames)
        self._scorer = Scorer(config, self._frames, self._views, self._counters)
        self._stored = StoredTruth(config, truth, self._counters, self._take_in)
        self._sequence = 0
        self._live_ns: int | None = None
        self._unplaced = ""  # frame of the last truth that could not be brought to the wanted one
        for transform in config.transforms:
            self._frames.add(transform.message())

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Take a message; frames pull stored truth, and tracks are judged."""
        sent: list[Message] = []
        if isinstance(message, Detections):
            if self._stored.begins_again(message.stamp_ns):
                self._scorer.restart()
            sent += self._publish(self._stored.up_to(message.stamp_ns))
        elif isinstance(message, Tracks):
            self._scorer.add_tracks(message)
        elif isinstance(message, Truth):
            sent += self._publish(self._captured(message))
        elif isinstance(message, CameraInfo):
            self._views.add(message)
        elif isinstance(message, StaticTransform | MovingTransform | Odometry):
            self._frames.add(message)
        return sent + self._scorer.due()

    def tick(self, now_ns: int) -> Sequence[Message]:
        """Return the truth that is due by the recording's own pace."""
        return self._publish(self._stored.due(now_ns))

    def wake_ns(self) -> int | None:
        """Return when the next truth is due by the recording's own pace."""
        return self._stored.wake_ns()

    def status(self) -> Status:
        """Return what the heartbeat shall say."""
        counters = dict(self._counters)
        if self._stored.problem:
            return Status(state="degraded", reason=self._stored.problem, counters=counters)
        if self._stored.finished and not self.foreign_inputs:
            return Status(state="finished", reason="all truth is out", counters=counters)
        if self._unplaced:
            reason = (
                f"no transform {self._config.frame_id} <- {self._unplaced}: "
                "the truth stays in its own frame; set transforms"
            )
            return Status(state="degraded", reason=reason, counters=counters)
        return Status(reason=self._quiet(), counters=counters)

    def _quiet(self) -> str:
        """Say why there is no truth."""
        if self.foreign_inputs:
            return "" if self._live_ns is not None else f"waits for {self.foreign_inputs[0].key}"
        return "there is no truth" if self._stored.empty else ""

    def _take_in(self, truth: Truth) -> Truth:
        """Let the scorer know of truth, and return it as it is to be published, but unplaced."""
        people = near(truth.people)
        if len(people) < len(truth.people):
            self._counters["too_far"] += len(truth.people) - len(people)
        frame_id = self._config.truth_frame or truth.frame_id
        truth = msgspec.structs.replace(truth, frame_id=frame_id, people=people)
        self._scorer.add_truth(truth)
        return truth

    def _captured(self, truth: Truth) -> list[Truth]:
        """Return what was captured now, unless a newer one came before it."""
        stamp_ns = truth.stamp_ns + round(self._config.offset_s * 1e9)
        before_ns, truth = self._live_ns, msgspec.structs.replace(truth, stamp_ns=stamp_ns)
        if before_ns is not None and before_ns - LEAD_NS < stamp_ns <= before_ns:
            self._counters["late_truth"] += 1
            return []
        self._live_ns = stamp_ns
        return [self._take_in(truth)]

    def _publish(self, messages: Iterable[Truth]) -> list[Message]:
        return [self._placed(truth) for truth in messages]

    def _placed(self, truth: Truth) -> Truth:
        """Bring truth to the wanted frame if the way is known, and number it."""
        target = self._config.frame_id
        place = self._frames.lookup(target, truth.frame_id, truth.stamp_ns)
        self._unplaced = "" if place is not None else truth.frame_id
        if place is None:
            self._counters["unplaced"] += 1
        elif target != truth.frame_id:
            truth = transform_truth(truth, place.matrix, target)
        self._sequence += 1
        return msgspec.structs.replace(truth, sequence=self._sequence - 1)
