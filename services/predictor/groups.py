"""Groups: people walking side by side, or standing around a common space."""

import math
from collections import Counter

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from people4d.messages import F64
from services.predictor.motion import Integers

WALKING_MPS = 0.3  # minimum speed of a walking person [m/s]
WALKING_M = 1.5  # maximum distance of two people walking together [m]
WALKING_DIFFER_MPS = 0.35  # maximum difference of the velocities of a pair [m/s]
SPACE_M = 0.7  # distance from a standing person to the centre of the space in front [m]
SPACE_APART_M = 0.8  # maximum distance of the centres of a common space [m]
STANDING_M = 2.5  # maximum distance of two people with a common space [m]
STANDING_UNKNOWN_M = 0.8  # maximum distance of standing people if a yaw is unknown [m]
LASTS_S = 1.5  # time constant of the score of a pair [s]
JOIN_SCORE, LEAVE_SCORE = (
    0.6,
    0.3,
)  # minimum score of a joining pair, maximum score of a separating pair


class GroupFinder:
    """Finds groups from the distance and motion of pairs over time."""

    def __init__(self) -> None:
        self._now_s = 0.0
        self._ids = np.zeros(0, np.int64)
        self._scores = np.zeros((0, 0))
        self._together = np.zeros((0, 0), bool)
        self._groups = np.zeros(0, np.int64)  # group of each person, 0: none
        self._next = 1

    def find_groups(
        self, now_s: float, ids: Integers, positions_m: F64, velocities_mps: F64, yaws_rad: F64
    ) -> Integers:
        """Return the group of each of N people, 0 for none.

        Args:
            now_s: Present time [s].
            ids: N identities.
            positions_m: Nx2 [m].
            velocities_mps: Nx2, filtered [m/s].
            yaws_rad: N, NaN if unknown.
        """
        self._match(ids)
        share = 1 - math.exp(-max(now_s - self._now_s, 0.0) / LASTS_S)
        self._now_s = now_s
        if len(ids) < 2:
            return self._groups
        evidence = self._evidence(positions_m, velocities_mps, yaws_rad)
        self._scores += share * (evidence - self._scores)
        self._together &= self._scores > LEAVE_SCORE
        self._together |= self._scores > JOIN_SCORE
        if self._together.any():
            _, components = connected_components(csr_array(self._together))
            self._groups = self._number_groups(components.astype(np.int64))
        else:
            self._groups = np.zeros(len(ids), np.int64)
        return self._groups

    def _match(self, ids: Integers) -> None:
        """Reorder the state to the present people."""
        if np.array_equal(ids, self._ids):
            return
        rows = {key: row for row, key in enumerate(self._ids.tolist())}
        before = np.array([rows.get(key, -1) for key in ids.tolist()], np.int64)
        new, old = np.flatnonzero(before >= 0), before[before >= 0]
        scores, together = np.zeros((len(ids), len(ids))), np.zeros((len(ids), len(ids)), bool)
        groups = np.zeros(len(ids), np.int64)
        scores[np.ix_(new, new)] = self._scores[np.ix_(old, old)]
        together[np.ix_(new, new)] = self._together[np.ix_(old, old)]
        groups[new] = self._groups[old]
        self._ids, self._scores, self._together, self._groups = ids, scores, together, groups

    def _evidence(self, positions_m: F64, velocities_mps: F64, yaws_rad: F64) -> F64:
        """Return the present evidence of each pair for a group, NxN from 0 to 1."""
        apart_m = cdist(positions_m, positions_m)
        differ_mps = cdist(velocities_mps, velocities_mps)
        walks = np.hypot(velocities_mps[:, 0], velocities_mps[:, 1]) > WALKING_MPS
        walking = (apart_m < WALKING_M) & (differ_mps < WALKING_DIFFER_MPS)
        walking &= walks[:, None] & walks
        heading = np.stack([np.cos(yaws_rad), np.sin(yaws_rad)], axis=1)
        facing = np.isfinite(yaws_rad)
        centres = positions_m + SPACE_M * np.where(facing[:, None], heading, 0)
        share_space = cdist(centres, centres) < SPACE_APART_M
        near = apart_m < STANDING_UNKNOWN_M
        both_face = facing[:, None] & facing
        standing = np.where(both_face, share_space & (apart_m < STANDING_M), near)
        standing &= ~walks[:, None] & ~walks
        evidence = (walking | standing).astype(float)
        np.fill_diagonal(evidence, 0)
        return evidence

    def _number_groups(self, components: Integers) -> Integers:
        """Return persistent numbers: a group keeps the number of the majority of its members."""
        groups, taken = np.zeros(len(components), np.int64), set[int]()
        sizes = Counter(components.tolist())
        for component in sorted(sizes, key=lambda c: -sizes[c]):
            if sizes[component] < 2:
                break
            members = components == component
            votes = Counter(self._groups[members].tolist())
            number = next((g for g, _ in votes.most_common() if g and g not in taken), 0)
            if not number:
                number, self._next = self._next, self._next + 1
            taken.add(number)
            groups[members] = number
        return groups
