"""Groups: people who walk alike side by side, or stand around a common space."""

import math
from collections import Counter

import numpy as np

from people4d.messages import F64
from services.predictor.config import GroupConfig
from services.predictor.motion import Flags, Integers


class GroupFinder:
    """Finds groups from the distance and motion of pairs over time."""

    def __init__(self, config: GroupConfig) -> None:
        self._config = config
        self._now_s = 0.0
        self._ids = np.zeros(0, np.int64)
        self._scores = np.zeros((0, 0))
        self._together = np.zeros((0, 0), bool)
        self._groups = np.zeros(0, np.int64)  # of each person, 0: none
        self._next = 1

    def update(
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
        config = self._config
        self._match(ids)
        share = 1 - math.exp(-max(now_s - self._now_s, 0.0) / config.lasts_s)
        self._now_s = now_s
        if len(ids) < 2:
            return self._groups
        evidence = self._evidence(positions_m, velocities_mps, yaws_rad)
        self._scores += share * (evidence - self._scores)
        self._together &= self._scores > config.leave_score
        self._together |= self._scores > config.join_score
        if self._together.any():
            self._groups = self._number(_components(self._together))
        else:
            self._groups = np.zeros(len(ids), np.int64)
        return self._groups

    def _match(self, ids: Integers) -> None:
        """Bring the state of the people before to those of now."""
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
        """Return for each pair how much they look like a group now, NxN from 0 to 1."""
        config = self._config
        apart_m = _distances(positions_m)
        differ_mps = _distances(velocities_mps)
        walks = np.hypot(velocities_mps[:, 0], velocities_mps[:, 1]) > config.walking_mps
        walking = (apart_m < config.walking_m) & (differ_mps < config.walking_differ_mps)
        walking &= walks[:, None] & walks
        heading = np.stack([np.cos(yaws_rad), np.sin(yaws_rad)], axis=1)
        facing = np.isfinite(yaws_rad)
        centres = positions_m + config.space_m * np.where(facing[:, None], heading, 0)
        share_space = _distances(centres) < config.space_apart_m
        near = apart_m < config.standing_unknown_m
        both_face = facing[:, None] & facing
        standing = np.where(both_face, share_space & (apart_m < config.standing_m), near)
        standing &= ~walks[:, None] & ~walks
        evidence = (walking | standing).astype(float)
        np.fill_diagonal(evidence, 0)
        return evidence

    def _number(self, components: Integers) -> Integers:
        """Return lasting numbers: a group keeps that of most of its members."""
        groups, taken = np.zeros(len(components), np.int64), set[int]()
        sizes = Counter(components.tolist())
        for component in sorted(sizes, key=lambda c: -sizes[c]):
            members = components == component
            if sizes[component] < 2:
                continue
            votes = Counter(self._groups[members].tolist())
            number = next((g for g, _ in votes.most_common() if g and g not in taken), 0)
            if not number:
                number, self._next = self._next, self._next + 1
            taken.add(number)
            groups[members] = number
        return groups


def _distances(points: F64) -> F64:
    x, y = (part[:, None] - part for part in points.T)
    found: F64 = np.sqrt(x * x + y * y)  # faster than np.hypot
    return found


def _components(together: Flags) -> Integers:
    """Return the number of the connected component of each row, the least row in it."""
    count = len(together)
    numbers = np.arange(count)
    linked = together | np.eye(count, dtype=bool)
    while True:
        least = np.where(linked, numbers, count).min(axis=1, initial=count)
        if np.array_equal(least, numbers):
            return numbers
        numbers = least
