"""Who is matched to whom in each frame (Bernardin & Stiefelhagen 2008, section 2.1).

A pair of the previous frame is kept as long as it may match; the rest is assigned for the largest
sum of similarities. People who do not have to be found take part, so that their tracks are
recognised as theirs; then both are left out of the counts.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.optimize import linear_sum_assignment

from common.metrics.record import BOOL, I64, EvaluationFrame, EvaluationSequence, Id
from common.metrics.similarity import Similarity
from people4d.messages import F64
from people4d.messages.base import check_finite, check_shape

KEPT = 1000.0  # worth of keeping a pair: more than all similarities of a frame together
ROUNDING = 1e-12  # a similarity at the threshold is a match, however it was rounded


@dataclass(frozen=True)
class FrameMatches:
    """One frame: people and tracks by number, and the pairs matched."""

    persons: I64  # N, index into Matching.persons
    tracks: I64  # M, index into Matching.tracks
    counted: BOOL  # N, who has to be found
    similarity: F64  # NxM
    rows: I64  # K, index into persons of each pair
    columns: I64  # K, index into tracks of each pair

    @cached_property
    def kept(self) -> BOOL:
        """Tracks that are judged (M): all but those of people who do not have to be found."""
        kept = np.ones(len(self.tracks), np.bool_)
        kept[self.columns[~self.counted[self.rows]]] = False
        return kept

    @cached_property
    def judged(self) -> tuple[I64, I64, F64]:
        """Persons, tracks and similarity of all who count."""
        similarity = self.similarity[np.ix_(self.counted, self.kept)]
        return self.persons[self.counted], self.tracks[self.kept], similarity

    @property
    def found(self) -> BOOL:
        """Pairs (K) whose person had to be found."""
        return self.counted[self.rows]


@dataclass(frozen=True)
class PersonHistory:
    """One person over the frames in which they had to be found."""

    person: Id
    frames: I64  # L, index into the frames of the sequence
    tracks: I64  # L, index into Matching.tracks, -1 where missed
    measured: BOOL  # L, matched to a track that was seen in this frame, not only predicted

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
    steps: tuple[FrameMatches, ...]  # one for each frame
    threshold: float  # least similarity of a match

    @cached_property
    def histories(self) -> tuple[PersonHistory, ...]:
        """Each person who had to be found at least once."""
        entries = _Entries()
        for index, step in enumerate(self.steps):
            entries.add(index, step, self.sequence.frames[index].tracked.was_predicted)
        return entries.histories(self.persons)


@dataclass
class _Entries:
    """One entry for each person who had to be found in a frame, frame after frame."""

    persons: list[I64] = field(default_factory=list)
    frames: list[I64] = field(default_factory=list)
    tracks: list[I64] = field(default_factory=list)
    measured: list[BOOL] = field(default_factory=list)

    def add(self, index: int, step: FrameMatches, predicted: BOOL) -> None:
        tracks = np.full(len(step.persons), -1)
        measured = np.zeros(len(step.persons), np.bool_)
        tracks[step.rows] = step.tracks[step.columns]
        measured[step.rows] = ~predicted[step.columns]
        self.persons.append(step.persons[step.counted])
        self.frames.append(np.full(np.count_nonzero(step.counted), index))
        self.tracks.append(tracks[step.counted])
        self.measured.append(measured[step.counted])

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
    """Matches frame after frame, for sequences that are not over yet.

    Args:
        similarity: How alike two people are.
        threshold: Least similarity of a match.
    """

    def __init__(self, similarity: Similarity, threshold: float = 0.5) -> None:
        self.persons: dict[Id, int] = {}  # number of each true person so far
        self.tracks: dict[Id, int] = {}  # number of each track so far
        self._similarity = similarity
        self._threshold = threshold
        self._previous: dict[int, int] = {}  # track of each person in the previous frame

    def step(self, frame: EvaluationFrame) -> FrameMatches:
        """Match the next frame.

        Raises:
            ValueError: The similarity has another shape than people by tracks, or is not finite.
        """
        step = _match_frame(
            _numbers(self.persons, frame.truth.ids),
            _numbers(self.tracks, frame.tracked.ids),
            frame.truth.counted,
            _checked(self._similarity(frame.truth, frame.tracked), frame),
            (self._previous, self._threshold),
        )
        if len(step.persons) and len(step.tracks):  # a frame without either breaks nothing
            persons, tracks = step.persons[step.rows], step.tracks[step.columns]
            self._previous = dict(zip(persons.tolist(), tracks.tolist(), strict=True))
        return step


def match(sequence: EvaluationSequence, similarity: Similarity, threshold: float = 0.5) -> Matching:
    """Match truth and tracks of every frame.

    Args:
        sequence: Truth and tracks.
        similarity: How alike two people are.
        threshold: Least similarity of a match.

    Returns:
        The matches; people and tracks by number.

    Raises:
        ValueError: The similarity has another shape than people by tracks, or is not finite.
    """
    matcher = Matcher(similarity, threshold)
    steps = tuple(matcher.step(frame) for frame in sequence.frames)
    return Matching(sequence, tuple(matcher.persons), tuple(matcher.tracks), steps, threshold)


def _match_frame(
    persons: I64, tracks: I64, counted: BOOL, similarity: F64, before: tuple[dict[int, int], float]
) -> FrameMatches:
    previous, threshold = before
    admissible = similarity >= threshold - ROUNDING
    last = np.array([previous.get(person, -1) for person in persons.tolist()], np.int64)
    kept = last[:, None] == tracks[None]
    # Two pairs are always worth more than one; who has to be found comes before who has not.
    worth = np.where(admissible, KEPT * kept + similarity + counted[:, None], 0.0)
    rows, columns = linear_sum_assignment(worth, maximize=True)
    valid = admissible[rows, columns]
    return FrameMatches(persons, tracks, counted, similarity, rows[valid], columns[valid])


def _checked(similarity: F64, frame: EvaluationFrame) -> F64:
    check_shape("similarity", similarity, (len(frame.truth.ids), len(frame.tracked.ids)))
    check_finite("similarity", similarity)
    return similarity


def _numbers(known: dict[Id, int], ids: Iterable[Id]) -> I64:
    """Return the number of each identity; new ones get the next."""
    return np.array([known.setdefault(one, len(known)) for one in ids], np.int64)
