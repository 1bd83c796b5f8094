"""Identity measures [Ristani 2016]: share of frames under one identity per person."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from common.metrics.counts import Counts, ratio
from common.metrics.matching import ROUNDING, Matching
from common.metrics.record import I64


@dataclass(frozen=True)
class IdentityCounts(Counts):
    """Counts of the identity measures, under the best one-to-one assignment of tracks."""

    idtp: int = 0  # number of people in frames matched by their own track
    idfn: int = 0  # number of people in frames without their own track
    idfp: int = 0  # number of tracks in frames without their own person

    @property
    def idf1(self) -> float:
        """2 IDTP / (2 IDTP + IDFP + IDFN)."""
        return ratio(2 * self.idtp, 2 * self.idtp + self.idfp + self.idfn)

    @property
    def idp(self) -> float:
        """Precision: share of the tracks under their own person."""
        return ratio(self.idtp, self.idtp + self.idfp)

    @property
    def idr(self) -> float:
        """Recall: share of the people under their own track."""
        return ratio(self.idtp, self.idtp + self.idfn)


def count_identity(matching: Matching) -> IdentityCounts:
    """Assign at most one track to each person, maximising the frames in which they match."""
    idtp, truths, tracked = identity_by_frame(matching).sum(axis=0).tolist()
    return IdentityCounts(idtp=idtp, idfn=truths - idtp, idfp=tracked - idtp)


def identity_by_frame(matching: Matching) -> I64:
    """Return IDTP, people and tracks of each frame (Fx3) under the assignment of all frames."""
    together = np.zeros((len(matching.persons), len(matching.tracks)), np.int64)
    pairs = []
    for matches in matching.frame_matches:
        persons, tracks, similarity = matches.evaluated
        rows, columns = np.nonzero(similarity >= matching.threshold - ROUNDING)
        pairs.append((persons[rows], tracks[columns], len(persons), len(tracks)))
        together[pairs[-1][:2]] += 1
    # The minimum of IDFN + IDFP is the maximum of IDTP: each common frame lowers both by one.
    own = np.zeros(together.shape, np.int64)
    own[linear_sum_assignment(together, maximize=True)] = 1
    counts = [(own[rows, columns].sum(), *sizes) for rows, columns, *sizes in pairs]
    return np.array(counts, np.int64).reshape(-1, 3)
