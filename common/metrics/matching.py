"""Matches of ground truth and hypotheses in each frame [Bernardin 2008, section 2.1].

A pair of the previous frame persists as long as it may match; the rest is assigned for the largest
sum of similarities. People who are out of view or occluded take part, so that their tracks are
recognised as theirs; then both are left out of the counts.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.optimize import linear_sum_assignment

from common.metrics.frame_scores import FrameScore, FrameScorer, IdSwitch
from common.metrics.record import BOOL, I64, EvaluationFrame, EvaluationSequence, FrameMatches, Id
from common.metrics.similarity import Similarity
from people4d.messages import F64
from people4d.messages.base import check_finite, check_shape

PERSISTENCE = 1000.0  # worth of a pair of the frame before: more than all similarities of a frame
ROUNDING = 1e-12  # a similarity at the threshold is a match, however it was rounded


@dataclass(frozen=True)
class PersonHistory:
    """One person over the frames in which they had to be tracked."""

    person: Id
    frames: I64  # L, index into the frames of the sequence
    tracks: I64  # L, index into Matching.tracks, -1 where missed
    measured: BOOL  # L, matched to a track with a measurement in this frame

    @property
    def matched(self) -> BOOL:
        """Frames (L) with a track."""
        return self.tracks >= 0


@dataclass(frozen=True)
class Matching:
    """All frames of a sequence, matched."""

    sequence: EvaluationSequence
    persons: tuple[Id, ...]  # all true people
    tracks: tuple[Id, ...]  # all tracks
    frame_matches: tuple[FrameMatches, ...]  # one for each frame
    threshold: float  # least similarity of a match

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
        """Each person who had to be tracked at least once."""
        entries = _Entries()
        for index, matches in enumerate(self.frame_matches):
            entries.add(index, matches, self.sequence.frames[index].hypotheses.was_predicted)
        return entries.histories(self.persons)


@dataclass
class _Entries:
    """One entry for each person who had to be tracked in a frame, frame after frame."""

    persons: list[I64] = field(default_factory=list)
    frames: list[I64] = field(default_factory=list)
    tracks: list[I64] = field(default_factory=list)
    measured: list[BOOL] = field(default_factory=list)

    def add(self, index: int, matches: FrameMatches, predicted: BOOL) -> None:
        tracks = np.full(len(matches.persons), -1)
        measured = np.zeros(len(matches.persons), np.bool_)
        tracks[matches.rows] = matches.tracks[matches.columns]
        measured[matches.rows] = ~predicted[matches.columns]
        self.persons.append(matches.persons[matches.required])
        self.frames.append(np.full(np.count_nonzero(matches.required), index))
        self.tracks.append(tracks[matches.required])
        self.measured.append(measured[matches.required])

    def histories(self, names: tuple[Id, ...]) -> tuple[PersonHistory, ...]:
        none = np.zeros(0, np.int64)
        persons = np.concatenate([none, *self.persons])
        frames = np.concatenate([none, *self.frames])
        tracks = np.concatenate([none, *self.tracks])
        measured = np.concatenate([none.astype(np.bool_), *self.measured])
        order = np.argsort(persons, kind="stable")  # by person, within a person by frame
        numbers, starts = np.unique(persons[order], return_index=True)
        rows = np.split(order, starts[1:])
        return tuple(
            PersonHistory(names[n], frames[r], tracks[r], measured[r])
            for n, r in zip(numbers, rows, strict=False)  # no entry at all still splits into one
        )


class Matcher:
    """Match frame after frame, for sequences that are not over yet.

    Args:
        similarity: Similarity of people and tracks.
        threshold: Least similarity of a match.
    """

    def __init__(self, similarity: Similarity, threshold: float = 0.5) -> None:
        self.persons: dict[Id, int] = {}  # number of each true person so far
        self.tracks: dict[Id, int] = {}  # number of each track so far
        self._similarity = similarity
        self._threshold = threshold
        self._previous: dict[int, int] = {}  # track of each person in the previous frame

    def match(self, frame: EvaluationFrame) -> FrameMatches:
        """Match the next frame.

        Raises:
            ValueError: The similarity has another shape than people by tracks, or is not finite.
        """
        matches = _match_frame(
            _numbers(self.persons, frame.truth.ids),
            _numbers(self.tracks, frame.hypotheses.ids),
            frame.truth.required,
            _checked(self._similarity(frame.truth, frame.hypotheses), frame),
            (self._previous, self._threshold),
        )
        if len(matches.persons) and len(matches.tracks):  # a frame without either breaks no pair
            persons, tracks = matches.persons[matches.rows], matches.tracks[matches.columns]
            self._previous = dict(zip(persons.tolist(), tracks.tolist(), strict=True))
        return matches


def match(sequence: EvaluationSequence, similarity: Similarity, threshold: float = 0.5) -> Matching:
    """Match truth and tracks of every frame.

    Args:
        sequence: Truth and tracks.
        similarity: Similarity of people and tracks.
        threshold: Least similarity of a match.

    Returns:
        The matches; people and tracks by number.

    Raises:
        ValueError: The similarity has another shape than people by tracks, or is not finite.
    """
    matcher = Matcher(similarity, threshold)
    frame_matches = tuple(matcher.match(frame) for frame in sequence.frames)
    return Matching(
        sequence, tuple(matcher.persons), tuple(matcher.tracks), frame_matches, threshold
    )


def _match_frame(
    persons: I64, tracks: I64, required: BOOL, similarity: F64, before: tuple[dict[int, int], float]
) -> FrameMatches:
    previous, threshold = before
    admissible = similarity >= threshold - ROUNDING
    last = np.array([previous.get(person, -1) for person in persons.tolist()], np.int64)
    persists = last[:, None] == tracks[None]
    # Two pairs are always worth more than one; people who have to be tracked come first.
    worth = np.where(admissible, PERSISTENCE * persists + similarity + required[:, None], 0.0)
    rows, columns = linear_sum_assignment(worth, maximize=True)
    valid = admissible[rows, columns]
    return FrameMatches(persons, tracks, required, similarity, rows[valid], columns[valid])


def _checked(similarity: F64, frame: EvaluationFrame) -> F64:
    check_shape("similarity", similarity, (len(frame.truth.ids), len(frame.hypotheses.ids)))
    check_finite("similarity", similarity)
    return similarity


def _numbers(known: dict[Id, int], ids: Iterable[Id]) -> I64:
    """Return the number of each identity; new ones get the next."""
    return np.array([known.setdefault(one, len(known)) for one in ids], np.int64)
