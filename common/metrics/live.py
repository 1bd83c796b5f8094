"""Score messages from tracks and ground truth as they come in (docs/method.md, section 9)."""

from collections import Counter, deque
from typing import Literal

import msgspec
import numpy as np

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transforms import wrap
from common.metrics.alignment.alignment import transform_truth
from common.metrics.alignment.truth_buffer import TruthBuffer
from common.metrics.field_of_view import CameraViews
from common.metrics.frame_scores import FrameScore, FrameScorer, ScoreTotals
from common.metrics.from_messages import ground_truth_of, hypotheses_of, plausible
from common.metrics.matching import Matcher
from common.metrics.pose import PoseErrors
from common.metrics.record import EvaluationFrame, FrameMatches
from common.metrics.similarity import GroundDistance
from people4d.messages import F64, Alignment, PersonScore, Score, Tally, Tracks, Truth

MAX_WAITING = 64  # maximum number of Tracks messages that wait for truth: two seconds of a camera
RESTART_NS = 10**9  # [ns] minimum step back of the stamps that begins a new playback
MAX_IDENTITIES = 100_000  # maximum number of counted identities, a bound on memory

RECENT_NS = 10 * 10**9
MAX_RECENT = 1024  # maximum number of recent frames: 10 s at 100 Hz


class TruthAlignment:
    """Correction of the truth's clock and frame; this base class corrects nothing."""

    estimate: Alignment | None = None  # published estimate
    offset_ns: int = 0  # [ns] offset added to stamps of the truth
    matrix: F64 | None = None  # 4x4, applied to truth in the frame of the tracks

    def restart(self) -> None:
        """Forget all observations."""

    def observe(self, tracks: Tracks, truth: TruthBuffer) -> None:
        """Use tracks with the truth at their time."""


class LiveScorer:
    """Brings the truth to the stamp and frame of each Tracks message, and scores it.

    Args:
        transforms: Transform buffer, which the caller fills.
        counters: Counts tracks that cannot be scored.
        gate_m: Maximum distance on the ground between a person and the track [m].
        alignment: Correction of the truth.
    """

    def __init__(
        self,
        transforms: TransformBuffer,
        counters: Counter[str],
        gate_m: float = 1.0,
        alignment: TruthAlignment | None = None,
    ) -> None:
        self.views = CameraViews(transforms)
        self._transforms, self._counters, self._gate_m = transforms, counters, gate_m
        self._truth = TruthBuffer()
        self._alignment = alignment or TruthAlignment()
        self._sequence = 0
        self.restart()

    def restart(self, since_ns: int | None = None) -> None:
        """Reset all counts after a restart of playback.

        Args:
            since_ns: Stamp of the first frame; earlier tracks belong to the previous playback.
        """
        self._waiting: deque[Tracks] = deque()
        self._since_ns = since_ns
        self._last_ns: int | None = None
        self._scores = SequenceScorer(self._gate_m)
        self._alignment.restart()

    def add_truth(self, truth: Truth) -> None:
        """Add truth with its stamp on the camera's clock, in any linked frame."""
        self._truth.add_truth(truth)

    def add_tracks(self, tracks: Tracks) -> None:
        """Queue tracks until the truth around them arrives; predicted messages do not count."""
        if tracks.predicted:
            return
        before_ns = [
            ns - tracks.stamp_ns for ns in (self._since_ns, self._last_ns) if ns is not None
        ]
        if any(0 < ns < RESTART_NS for ns in before_ns):
            self._counters["late_tracks"] += 1
            return
        if self._last_ns is not None and tracks.stamp_ns < self._last_ns:
            self.restart()
        self._last_ns = tracks.stamp_ns
        if self._truth.newest_ns is None:
            return  # no truth is published: no fault
        self._waiting.append(tracks)
        if len(self._waiting) > MAX_WAITING:
            self._waiting.popleft()
            self._counters["without_truth"] += 1

    def due(self) -> list[Score]:
        """Return the scores of all tracks whose truth has arrived."""
        scores = []
        while self._waiting and self._is_due(self._waiting[0]):
            tracks = self._waiting.popleft()
            truth = self._truth_for(tracks)
            if truth is not None:
                self._alignment.observe(tracks, self._truth)
                scores.append(self._score(tracks, truth))
        return scores

    def _is_due(self, tracks: Tracks) -> bool:
        newest_ns = self._truth.newest_ns
        return newest_ns is not None and tracks.stamp_ns - self._alignment.offset_ns <= newest_ns

    def _truth_for(self, tracks: Tracks) -> Truth | None:
        """Return the truth at the stamp and in the frame of the tracks."""
        truth = self._truth.at(tracks.stamp_ns - self._alignment.offset_ns)
        if truth is None:
            self._counters["without_truth"] += 1
            return None
        matrix = self._alignment.matrix
        if truth.frame_id != tracks.frame_id:
            pose = self._transforms.lookup(tracks.frame_id, truth.frame_id, tracks.stamp_ns)
            if pose is None:
                self._counters["without_transform"] += 1
                return None
            matrix = pose.matrix if matrix is None else matrix @ pose.matrix
        if matrix is not None:
            truth = transform_truth(truth, matrix, tracks.frame_id)
        return msgspec.structs.replace(truth, people=plausible(truth.people))

    def _score(self, tracks: Tracks, truth: Truth) -> Score:
        if self._scores.identities > MAX_IDENTITIES:
            self._counters["recounts"] += 1
            self._scores = SequenceScorer(self._gate_m)
        positions = [person.position_m for person in truth.people]
        outside = self.views.outside(positions, tracks.frame_id, tracks.stamp_ns)
        people, false_alarms = self._scores.add_frame(
            EvaluationFrame(
                stamp_ns=tracks.stamp_ns,
                truth=ground_truth_of(truth.people, outside),
                hypotheses=hypotheses_of(tracks.tracks),
            )
        )
        self._sequence += 1
        return Score(
            stamp_ns=tracks.stamp_ns,
            sequence=self._sequence - 1,
            trace=tracks.trace,
            frame_id=tracks.frame_id,
            camera=tracks.camera,
            people=people,
            false_alarms=false_alarms,
            recent=self._scores.totals.recent(),
            total=self._scores.totals.total(),
            id_consistency=self._scores.consistency.share(),
            alignment=self._alignment.estimate,
        )


class RunningTotals:
    """Totals of the last 10 s and of all frames."""

    def __init__(self) -> None:
        self._window: deque[tuple[int, ScoreTotals]] = deque(maxlen=MAX_RECENT)
        self._total = ScoreTotals()
        self._first_ns = self._last_ns = 0

    def add_frame(self, stamp_ns: int, totals: ScoreTotals) -> None:
        """Add one frame."""
        self._first_ns = self._first_ns if self._total.frames else stamp_ns
        self._last_ns = stamp_ns
        self._total += totals
        self._window.append((stamp_ns, totals))
        while self._window[0][0] <= stamp_ns - RECENT_NS:
            self._window.popleft()

    def recent(self) -> Tally:
        """Return the totals of the last 10 s."""
        first_ns = self._window[0][0] if self._window else self._last_ns
        sums = sum((totals for _, totals in self._window), start=ScoreTotals())
        return sums.tally(self._last_ns - first_ns)

    def total(self) -> Tally:
        """Return the totals of all frames."""
        return self._total.tally(self._last_ns - self._first_ns)


class IdConsistency:
    """Share of each person's matches under the most frequent track."""

    def __init__(self) -> None:
        self._tracks: dict[str, Counter[int]] = {}

    def add_match(self, person: str, track: int) -> None:
        """Count a match."""
        self._tracks.setdefault(person, Counter())[track] += 1

    def share(self, *persons: str) -> float | None:
        """Return the share over the given people, or all; None if there is no match."""
        counters = [self._tracks[p] for p in persons or self._tracks if p in self._tracks]
        matches = sum(counter.total() for counter in counters)
        return sum(max(c.values()) for c in counters) / matches if matches else None


class SequenceScorer:
    """Scores of one playback, frame by frame."""

    def __init__(self, gate_m: float) -> None:
        self.totals = RunningTotals()
        self.consistency = IdConsistency()
        self._matcher = Matcher(GroundDistance(gate_m))
        self._scorer = FrameScorer()

    @property
    def identities(self) -> int:
        """Number of people and tracks so far."""
        return len(self._matcher.persons) + len(self._matcher.tracks)

    def add_frame(self, frame: EvaluationFrame) -> tuple[tuple[PersonScore, ...], tuple[int, ...]]:
        """Score the next frame.

        Returns:
            Scores of all people in the truth, and ids of tracks that are false alarms.
        """
        matches = self._matcher.match(frame)
        score = self._scorer.score(frame, matches)
        self.totals.add_frame(frame.stamp_ns, score.totals)
        for row, column in zip(matches.rows, matches.columns, strict=True):
            if matches.required[row]:
                track = int(frame.hypotheses.ids[column])
                self.consistency.add_match(str(frame.truth.ids[row]), track)
        alarms = matches.evaluated_tracks.copy()
        alarms[matches.columns] = False
        ids = tuple(int(frame.hypotheses.ids[k]) for k in np.flatnonzero(alarms))
        return self._people(frame, matches, score), ids

    def _people(
        self, frame: EvaluationFrame, matches: FrameMatches, score: FrameScore
    ) -> tuple[PersonScore, ...]:
        pairs = dict(zip(matches.rows.tolist(), matches.columns.tolist(), strict=True))
        rows = {i: k for k, i in enumerate(i for i in pairs if frame.truth.in_view[i])}
        switched = {switch.person for switch in score.switches}
        people = []
        for i, name in enumerate(frame.truth.ids):
            j = pairs.get(i)
            person = PersonScore(
                id=str(name),
                view=_view_of(frame, i),
                track=None if j is None else int(frame.hypotheses.ids[j]),
                predicted=j is not None and bool(frame.hypotheses.was_predicted[j]),
                switched=name in switched,
                consistency=self.consistency.share(str(name)),
            )
            people.append(_with_errors(person, score.errors, rows[i]) if i in rows else person)
        return tuple(people)


def _view_of(frame: EvaluationFrame, row: int) -> Literal["inside", "outside", "unknown"]:
    if frame.truth.out_of_view is None:
        return "unknown"
    return "inside" if frame.truth.in_view[row] else "outside"


def _with_errors(person: PersonScore, errors: PoseErrors, row: int) -> PersonScore:
    position_m, velocity_mps = errors.position_m[row], errors.velocity_mps[row]
    yaw_rad = float(errors.yaw_estimated_rad[row] - errors.yaw_true_rad[row])
    return msgspec.structs.replace(
        person,
        position_error_m=position_m if np.isfinite(position_m).all() else None,
        velocity_error_mps=velocity_mps if np.isfinite(velocity_mps).all() else None,
        yaw_error_rad=wrap(yaw_rad) if np.isfinite(yaw_rad) else None,
    )
