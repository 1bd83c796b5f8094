"""Matches of ground truth and hypotheses in each frame [Bernardin 2008, section 2.1].

A pair of the previous frame persists while its similarity suffices; the others are assigned at the
maximum sum of similarities. People out of view or occluded take part, so their tracks are known;
then both are excluded from the counts.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import linear_sum_assignment

from common.metrics.frame_scores import FrameScore, FrameScorer, IdSwitch
from common.metrics.record import BOOL, I64, EvaluationFrame, EvaluationSequence, FrameMatches, Id
from common.metrics.similarity import Similarity
from people4d.messages.base import check_finite, check_shape

PERSISTENCE = 1000.0  # bonus of a pair of the previous frame: above all similarities of a frame
ROUNDING = 1e-12  # tolerance of the threshold, for rounded similarities


@dataclass(frozen=True)
class PersonHistory:
    """One person over the frames in which tracking is required."""

    person: Id
    frames: I64  # L, index into the frames of the sequence
    tracks: I64  # L, index into Matching.tracks, -1 if missed
    measured: BOOL  # L, matched to a track with a measurement in this frame

    @property
    def matched(self) -> BOOL:
        """Frames (L) with a track."""
        return self.tracks >= 0


@dataclass(frozen=True)
class Matching:
    """All frames of a sequence, matched."""

    sequence: EvaluationSequence
    persons: tuple[Id, ...]  # people of the ground truth
    tracks: tuple[Id, ...]  # tracks of the sequence
    frame_matches: tuple[FrameMatches, ...]  # one for each frame
    threshold: float  # minimum similarity of a match

    @cached_property
    def frame_scores(self) -> tuple[FrameScore, ...]:
        """Scores of each frame."""
        scorer = FrameScorer()
        frames = zip(self.sequence.frames, self.frame_matches, strict=True)
        return tuple(scorer.score(frame, matches) for frame, matches in frames)

    @property
    def id_switches(self) -> tuple[IdSwitch, ...]:
        """Every ID switch, in order of time."""
        return tuple(switch for score in self.frame_scores for switch in score.switches)

    @cached_property
    def histories(self) -> tuple[PersonHistory, ...]:
        """History of each person to be tracked at least once."""
        none = np.zeros((4, 0), np.int64)
        entries = np.hstack([none, *map(self._entries, range(len(self.frame_matches)))])
        histories = []
        for number in np.unique(entries[0]):
            _, frames, tracks, measured = entries[:, entries[0] == number]
            histories.append(PersonHistory(self.persons[number], frames, tracks, measured > 0))
        return tuple(histories)

    def _entries(self, index: int) -> I64:
        """Return person, frame, track and flag (4xL) of all people to be tracked in a frame.

        The track is -1 for a missed person; the flag is 1 if the track has a measurement.
        """
        matches, frame = self.frame_matches[index], self.sequence.frames[index]
        entries = np.repeat([[0], [index], [-1], [0]], len(matches.persons), axis=1)
        entries[0] = matches.persons
        entries[2, matches.rows] = matches.tracks[matches.columns]
        entries[3, matches.rows] = ~frame.hypotheses.was_predicted[matches.columns]
        return entries[:, matches.required]


class Matcher:
    """Matches people and tracks frame by frame; a match has at least the threshold's similarity."""

    def __init__(self, similarity: Similarity, threshold: float = 0.5) -> None:
        self.persons: dict[Id, int] = {}  # number of each true person so far
        self.tracks: dict[Id, int] = {}  # number of each track so far
        self._similarity = similarity
        self._threshold = threshold
        self._previous: dict[int, int] = {}  # track of each person in the previous frame

    def match(self, frame: EvaluationFrame) -> FrameMatches:
        """Match the next frame; ValueError if the similarity does not fit people and tracks."""
        persons = _numbers(self.persons, frame.truth.ids)
        tracks = _numbers(self.tracks, frame.hypotheses.ids)
        similarity, required = self._similarity(frame.truth, frame.hypotheses), frame.truth.required
        check_shape("similarity", similarity, (len(persons), len(tracks)))
        check_finite("similarity", similarity)
        admissible = similarity >= self._threshold - ROUNDING
        last = np.array([self._previous.get(one, -1) for one in persons.tolist()], np.int64)
        persists = last[:, None] == tracks[None]
        # Two pairs always weigh more than one; unoccluded people in view come before others. A
        # person partly outside the view may be measured by the visible part.
        first = required | ~frame.truth.in_view
        worth = np.where(admissible, PERSISTENCE * persists + similarity + first[:, None], 0.0)
        rows, columns = linear_sum_assignment(worth, maximize=True)
        valid = admissible[rows, columns]
        rows, columns = rows[valid], columns[valid]
        if len(persons) and len(tracks):  # a frame without people or tracks keeps all pairs
            pairs = zip(persons[rows].tolist(), tracks[columns].tolist(), strict=True)
            self._previous = dict(pairs)
        return FrameMatches(persons, tracks, required, similarity, rows, columns)


def match(sequence: EvaluationSequence, similarity: Similarity, threshold: float = 0.5) -> Matching:
    """Match truth and tracks of every frame; for the arguments see `Matcher`.

    ValueError if the similarity has another shape than people by tracks, or is not finite.
    """
    matcher = Matcher(similarity, threshold)
    matches = tuple(map(matcher.match, sequence.frames))
    return Matching(sequence, tuple(matcher.persons), tuple(matcher.tracks), matches, threshold)


def _numbers(known: dict[Id, int], ids: Iterable[Id]) -> I64:
    """Return the number of each identity; new ones get the next."""
    return np.array([known.setdefault(one, len(known)) for one in ids], np.int64)
