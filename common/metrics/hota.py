"""HOTA, higher order tracking accuracy [Luiten 2021]."""

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from common.metrics.counts import Counts, ratios
from common.metrics.matching import ROUNDING, Matching
from common.metrics.record import I64
from people4d.messages import F64

ALPHAS: F64 = np.arange(1.0, 20.0) * 0.05  # localisation thresholds 0.05 to 0.95


def _zeros() -> F64:
    return np.zeros(len(ALPHAS))


@dataclass(frozen=True)
class HotaCounts(Counts):
    """Counts of HOTA for all thresholds of ALPHAS; each property is per threshold, too."""

    tp: F64 = field(default_factory=_zeros)
    fn: F64 = field(default_factory=_zeros)
    fp: F64 = field(default_factory=_zeros)
    association: F64 = field(default_factory=_zeros)  # sum over TP of A(c)

    @property
    def hota(self) -> F64:
        """Geometric mean of detection and association accuracy."""
        return np.sqrt(self.det_a * self.ass_a)

    @property
    def det_a(self) -> F64:
        """Detection accuracy TP / (TP + FN + FP)."""
        return ratios(self.tp, self.tp + self.fn + self.fp)

    @property
    def ass_a(self) -> F64:
        """Association accuracy: mean of A(c) = TPA / (TPA + FNA + FPA) over TP."""
        return ratios(self.association, self.tp)


def count_hota(matching: Matching) -> HotaCounts:
    """Match each frame for the best overall alignment of identities, then count."""
    shape = len(matching.persons), len(matching.tracks)
    alignment, person_frames, track_frames = _align(matching, shape)
    persons, tracks, similarity = _pairs(matching, alignment)
    columns = []
    for alpha in ALPHAS:
        hit = similarity >= alpha - ROUNDING
        together = np.zeros(shape)  # TPA of each pair of identities
        np.add.at(together, (persons[hit], tracks[hit]), 1.0)
        either = person_frames[:, None] + track_frames[None] - together
        columns.append([hit.sum(), (together * ratios(together, either)).sum()])
    tp, association = np.array(columns, np.float64).T
    return HotaCounts(tp, person_frames.sum() - tp, track_frames.sum() - tp, association)


def _align(matching: Matching, shape: tuple[int, int]) -> tuple[F64, F64, F64]:
    """Return the Jaccard alignment of each pair of identities, and the frames of each."""
    together, person_frames, track_frames = np.zeros(shape), np.zeros(shape[0]), np.zeros(shape[1])
    for matches in matching.frame_matches:
        persons, tracks, similarity = matches.evaluated
        either = similarity.sum(0, keepdims=True) + similarity.sum(1, keepdims=True) - similarity
        together[np.ix_(persons, tracks)] += ratios(similarity, either)
        person_frames[persons] += 1
        track_frames[tracks] += 1
    either = person_frames[:, None] + track_frames[None] - together
    return ratios(together, either), person_frames, track_frames


def _pairs(matching: Matching, alignment: F64) -> tuple[I64, I64, F64]:
    """Return person, track and similarity of the pairs assigned in all frames."""
    found = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))]
    for matches in matching.frame_matches:
        persons, tracks, similarity = matches.evaluated
        worth = alignment[np.ix_(persons, tracks)] * similarity
        rows, columns = linear_sum_assignment(worth, maximize=True)
        found.append((persons[rows], tracks[columns], similarity[rows, columns]))
    persons, tracks, similarity = (np.concatenate(column) for column in zip(*found, strict=True))
    return persons, tracks, similarity
