"""Judges tracks by the truth while both come in (method book section 9)."""

from collections import Counter, deque

import msgspec

from common.geometry.transform_buffer import TransformBuffer
from common.metrics import TruthBuffer, transform_truth
from people4d.messages import Score, Tracks, Truth
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.scoring.aligner import Aligner
from services.gt_bridge.scoring.judge import Judge, frame_of, near
from services.gt_bridge.scoring.views import Views

WAITING = 64  # tracks that wait for truth: two seconds of a camera
BACK_NS = 10**9  # tracks from so long before the last ones begin a new playback
IDENTITIES = 100_000  # after so many the count begins anew, so that memory is bounded


class Scorer:
    """Brings the truth to the stamp and frame of each Tracks message, and judges it.

    Args:
        config: Gate and alignment.
        frames: Transforms, which others add.
        views: Cameras, which others add.
        counters: Where tracks that cannot be judged are counted.
    """

    def __init__(
        self, config: GtBridgeConfig, frames: TransformBuffer, views: Views, counters: Counter[str]
    ) -> None:
        self._config = config
        self._frames, self._views, self._counters = frames, views, counters
        self._trail = TruthBuffer()
        self._aligner = Aligner(config)
        self._sequence = 0
        self.restart()

    def restart(self) -> None:
        """Begin to count anew: playback began again, and people are elsewhere."""
        self._waiting: deque[Tracks] = deque()
        self._last_ns: int | None = None
        self._judge = Judge(self._config.gate_m)
        self._aligner.restart()

    def add_truth(self, truth: Truth) -> None:
        """Take truth with its stamp on the camera's clock, in the frame of its source."""
        self._trail.add(truth)

    def add_tracks(self, tracks: Tracks) -> None:
        """Take tracks; they wait until the truth around them is there."""
        if self._last_ns is not None and tracks.stamp_ns < self._last_ns:
            if tracks.stamp_ns > self._last_ns - BACK_NS:
                self._counters["late_tracks"] += 1
                return
            self.restart()
        self._last_ns = tracks.stamp_ns
        if self._trail.newest_ns is None:
            return  # no truth at all is no fault
        self._waiting.append(tracks)
        if len(self._waiting) > WAITING:
            self._waiting.popleft()
            self._counters["without_truth"] += 1

    def due(self) -> list[Score]:
        """Return the scores of all tracks whose truth is there by now."""
        scores = []
        while self._waiting and self._is_due(self._waiting[0]):
            tracks = self._waiting.popleft()
            truth = self._truth_for(tracks)
            if truth is not None:
                self._aligner.observe(tracks, self._trail, self._frames)
                scores.append(self._score(tracks, truth))
        return scores

    def _is_due(self, tracks: Tracks) -> bool:
        newest_ns = self._trail.newest_ns
        return newest_ns is not None and tracks.stamp_ns - self._aligner.offset_ns <= newest_ns

    def _truth_for(self, tracks: Tracks) -> Truth | None:
        """Return the truth at the stamp and in the frame of the tracks."""
        truth = self._trail.at(tracks.stamp_ns - self._aligner.offset_ns)
        if truth is None:
            self._counters["without_truth"] += 1
            return None
        place = self._frames.lookup(tracks.frame_id, truth.frame_id, tracks.stamp_ns)
        if place is None:
            self._counters["without_transform"] += 1
            return None
        truth = transform_truth(truth, self._aligner.matrix @ place.matrix, tracks.frame_id)
        return msgspec.structs.replace(truth, people=near(truth.people))

    def _score(self, tracks: Tracks, truth: Truth) -> Score:
        if self._judge.identities > IDENTITIES:
            self._counters["recounts"] += 1
            self._judge = Judge(self._config.gate_m)
        positions = [person.position_m for person in truth.people]
        outside = self._views.outside(positions, tracks.frame_id, tracks.stamp_ns)
        people, false_alarms = self._judge.judge(frame_of(tracks, truth, outside))
        self._sequence += 1
        return Score(
            stamp_ns=tracks.stamp_ns,
            sequence=self._sequence - 1,
            trace=tracks.trace,
            frame_id=tracks.frame_id,
            camera=tracks.camera,
            people=people,
            false_alarms=false_alarms,
            recent=self._judge.recent,
            total=self._judge.total,
            id_consistency=self._judge.consistency,
            alignment=self._aligner.found,
        )
