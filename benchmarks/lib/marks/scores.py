"""Scores of tracks against annotations: identity, position and yaw at each annotated point.

A track matches an annotation ("mark") if its box in the image contains the point, or its position
is near the surface there (the box of a head does not contain the torso). Matches are one to one.
Tracks with a detection come before predicted ones. If a box contains several marks, the nearest to
its position comes first.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import linear_sum_assignment

from common.metrics.counts import ratio
from common.metrics.matching import Matching, match
from common.metrics.pose import rmse
from common.metrics.record import EvaluationFrame, EvaluationSequence, GroundTruth, Hypotheses
from common.metrics.scores import Row, score_matching
from evaluation.annotations.marks import Mark
from people4d.messages import F64
from services.tracker.sort3d.association import assign

TORSO_HEIGHT = 0.35  # height of the torso in a box, from its top, as a share of the box
PREDICTED_PX = 10_000.0  # [px] cost of a predicted track, above all distances in an image
PX_PER_M = 250.0  # [px/m] cost of a distance on the ground: its size at a depth of about 2 m
UNKNOWN_M = 1e6  # [m] coordinates of an unknown position
FAR_M = 0.5  # [m] maximum error of a correct position
FACING_RAD = math.radians(45)


@dataclass(frozen=True)
class TrackedPerson:
    """One track in one frame."""

    id: int
    box_xyxy_px: F64  # 4, box of the detection, or around the projected torso if predicted
    predicted: bool = False  # True if no detection in this frame belongs to the track
    position_m: F64 | None = None  # 3, in the map; None: the tracker has boxes only
    detected_m: F64 | None = None  # 3, in the map: position of the detection in the box
    yaw_rad: float | None = None  # in the map


@dataclass(frozen=True)
class MarkTruth:
    """One mark with surface and yaw."""

    mark: Mark
    point_m: F64 | None  # 3, surface at the mark, in the map; None if depth is missing
    yaw_rad: float | None  # yaw in the map; None: uncertain


@dataclass(frozen=True)
class MarkOutcome:
    """Comparison of one mark with its track."""

    frame: int
    truth: MarkTruth
    track: TrackedPerson | None  # track on the mark
    is_owner: bool  # True: the track is assigned to this person, one to one

    @property
    def distance_m(self) -> float | None:
        """Distance on the ground from the surface at the mark."""
        track, point_m = self.track, self.truth.point_m
        if track is None or track.position_m is None or point_m is None:
            return None
        return float(np.linalg.norm((track.position_m - point_m)[:2]))

    @property
    def yaw_error_rad(self) -> float | None:
        """Absolute error of the yaw."""
        if self.track is None or self.track.yaw_rad is None or self.truth.yaw_rad is None:
            return None
        return abs(math.remainder(self.track.yaw_rad - self.truth.yaw_rad, 2 * math.pi))


@dataclass(frozen=True)
class Share:
    """A part of a total."""

    part: int
    total: int

    def __str__(self) -> str:
        return f"{self.part} ({100 * ratio(self.part, self.total):.0f} %)"


@dataclass(frozen=True)
class Figures:
    """Figures over some marks."""

    found: Share
    owned: Share  # number of marks with the correct identity
    far: Share  # number of wrong positions among the measured positions
    facing: Share  # yaws within 45 degrees, of all annotated ones of tracks with a position


def figures(outcomes: Sequence[MarkOutcome]) -> Figures:
    """Return the figures over some marks."""
    total = len(outcomes)
    distances_m = [o.distance_m for o in outcomes if o.distance_m is not None]
    located = [o for o in outcomes if o.track is not None and o.track.position_m is not None]
    marked = [o for o in located if o.truth.yaw_rad is not None]
    good = sum(o.yaw_error_rad is not None and o.yaw_error_rad <= FACING_RAD for o in marked)
    return Figures(
        found=Share(sum(o.track is not None for o in outcomes), total),
        owned=Share(sum(o.is_owner for o in outcomes), total),
        far=Share(sum(d > FAR_M for d in distances_m), len(distances_m)),
        facing=Share(good, len(marked)),
    )


class MarkScores:
    """Scores of one tracker on a marked recording.

    Args:
        truth: Marks by frame, in order; other frames are not scored.
        tracks: Tracks by frame.
        rate_hz: Frames a second.
    """

    def __init__(
        self,
        truth: Mapping[int, Sequence[MarkTruth]],
        tracks: Mapping[int, Sequence[TrackedPerson]],
        rate_hz: float,
    ) -> None:
        self._truth, self._tracks, self._rate_hz = truth, tracks, rate_hz

    @cached_property
    def outcomes(self) -> tuple[MarkOutcome, ...]:
        """Outcome of every mark."""
        pairs = self._pairs
        owner_of = _owners(pairs)
        outcomes = []
        for frame, truths in self._truth.items():
            for truth in truths:
                track, person = pairs.get((frame, truth.mark.person)), truth.mark.person
                is_owner = track is not None and owner_of.get(person) == track.id
                outcomes.append(MarkOutcome(frame, truth, track, is_owner))
        return tuple(outcomes)

    @property
    def id_switches(self) -> int:
        """Number of ID switches."""
        return len(self._matching.id_switches)

    @property
    def takeovers(self) -> int:
        """Number of changes of a track from one person to another."""
        last, count = dict[int, str](), 0
        for (_, person), track in self._pairs.items():
            count += last.setdefault(track.id, person) != person
            last[track.id] = person
        return count

    def row(self) -> Row:
        """Return the metrics of all marks, with errors of measured positions and known yaws."""
        distances_m = [o.distance_m for o in self.outcomes if o.distance_m is not None]
        yaws_rad = [o.yaw_error_rad for o in self.outcomes if o.yaw_error_rad is not None]
        return score_matching(self._matching).row() | {
            "position_rmse_m": rmse(np.array(distances_m)),
            "yaw_rmse_deg": rmse(np.degrees(yaws_rad)),
        }

    @property
    def frames(self) -> list[int]:
        """Annotated frames, in order."""
        return list(self._truth)

    def within(self, frames: Collection[int]) -> "MarkScores":
        """Return the scores over some frames."""
        chosen = {frame: truths for frame, truths in self._truth.items() if frame in frames}
        return MarkScores(chosen, self._tracks, self._rate_hz)

    @cached_property
    def _matching(self) -> Matching:
        frames = tuple(self._frame(frame) for frame in self._truth)
        return match(EvaluationSequence("marks", frames), on_marks)

    @cached_property
    def _pairs(self) -> dict[tuple[int, str], TrackedPerson]:
        """Track on each mark by frame and person, in order of frames."""
        pairs = {}
        for frame, matches in zip(self._truth, self._matching.frame_matches, strict=True):
            truths, tracks = self._truth[frame], self._tracks.get(frame, ())
            for i, j in sorted(zip(matches.rows.tolist(), matches.columns.tolist(), strict=True)):
                pairs[frame, truths[i].mark.person] = tracks[j]
        return pairs

    def _frame(self, frame: int) -> EvaluationFrame:
        marks = [truth.mark for truth in self._truth[frame]]
        tracks = self._tracks.get(frame, ())
        points = [(m.u_px, m.v_px, m.u_px, m.v_px) for m in marks]
        boxes = np.array([t.box_xyxy_px for t in tracks], np.float64).reshape(-1, 4)
        return EvaluationFrame(
            stamp_ns=round(frame * 1e9 / self._rate_hz),
            truth=GroundTruth(
                ids=tuple(m.person for m in marks),
                boxes_xyxy_px=np.array(points, np.float64).reshape(-1, 4),
                positions_m=_rows([truth.point_m for truth in self._truth[frame]]),
            ),
            hypotheses=Hypotheses(
                ids=tuple(t.id for t in tracks),
                boxes_xyxy_px=boxes,
                positions_m=_rows(
                    [t.detected_m if t.position_m is None else t.position_m for t in tracks]
                ),
                predicted=np.array([t.predicted for t in tracks], np.bool_),
            ),
        )


def on_marks(truth: GroundTruth, tracked: Hypotheses) -> F64:
    """Return 1 (NxM) for the track on each mark, else 0."""
    similarity = np.zeros((len(truth.ids), len(tracked.ids)))
    if not similarity.size:
        return similarity
    assert truth.boxes_xyxy_px is not None
    assert tracked.boxes_xyxy_px is not None
    points = truth.boxes_xyxy_px[:, None, :2]
    corners = tracked.boxes_xyxy_px[None]
    low, high = corners[..., :2], corners[..., 2:]
    torsos = low + (high - low) * (0.5, TORSO_HEIGHT)
    apart_px, distances_m = np.linalg.norm(points - torsos, axis=-1), _distances(truth, tracked)
    cost = np.where(np.isfinite(distances_m), PX_PER_M * distances_m, apart_px)
    holds = ((points >= low) & (points <= high)).all(axis=-1)
    cost[~holds & ~(distances_m <= FAR_M)] = np.inf
    for i, j in assign(cost + PREDICTED_PX * tracked.was_predicted):
        similarity[i, j] = 1.0
    return similarity


def _distances(truth: GroundTruth, tracked: Hypotheses) -> F64:
    """Return the distances on the ground (NxM) from marks to tracks; NaN if unknown."""
    if truth.positions_m is None or tracked.positions_m is None:
        return np.full((len(truth.ids), len(tracked.ids)), np.nan)
    marks_m, tracks_m = truth.positions_m[:, None, :2], tracked.positions_m[None, :, :2]
    unknown = (marks_m == UNKNOWN_M) | (tracks_m == UNKNOWN_M)
    distances_m: F64 = np.linalg.norm(np.where(unknown, np.nan, marks_m - tracks_m), axis=-1)
    return distances_m


def _rows(positions_m: Sequence[F64 | None]) -> F64:
    """Return positions (Nx3), UNKNOWN_M if unknown."""
    unknown = np.full(3, UNKNOWN_M)
    return np.array([unknown if p is None else p for p in positions_m]).reshape(-1, 3)


def _owners(pairs: Mapping[tuple[int, str], TrackedPerson]) -> dict[str, int]:
    """Return the track of each person, assigned one to one for the most marks."""
    persons = sorted({person for _, person in pairs})
    tracks = sorted({track.id for track in pairs.values()})
    together = np.zeros((len(persons), len(tracks)))
    for (_, person), track in pairs.items():
        together[persons.index(person), tracks.index(track.id)] += 1
    rows, columns = linear_sum_assignment(together, maximize=True)
    return {persons[i]: tracks[j] for i, j in zip(rows, columns, strict=True) if together[i, j]}
