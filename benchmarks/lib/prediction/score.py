"""Scores of predictions: errors relative to constant velocity, calibration, groups."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from evaluation.datasets.walks import Walks, predict
from people4d.messages import F64, PersonPrediction, Predictions, Tracks
from services.predictor.build import build
from services.predictor.config import PredictorConfig

STANDING_M, GOING_ON_RAD, MOTION_S = 0.6, np.radians(25.0), 3.0  # limits of MotionProbabilities


@dataclass(frozen=True)
class PredictionPairs:
    """K predictions at H horizons, with the truth (NaN if unknown)."""

    horizons_s: F64  # H
    means_m: F64  # KxHx2
    covariances_m2: F64  # KxHx2x2
    constant_m: F64  # KxHx2, prediction by constant velocity
    truth_m: F64  # KxHx2
    positions_m: F64  # Kx2, at present
    velocities_mps: F64  # Kx2, at present
    motion: F64  # Kx3, probabilities of standing, going on, turning

    def errors_m(self) -> F64:
        """Return the mean errors at the horizons, H."""
        return _mean_distance(self.means_m - self.truth_m)

    def constant_errors_m(self) -> F64:
        """Return the mean errors of constant velocity at the horizons, H."""
        return _mean_distance(self.constant_m - self.truth_m)

    def displacements_m(self) -> tuple[F64, F64]:
        """Return the errors of the prediction and of constant velocity with known truth, KxH."""
        complete = np.isfinite(self.truth_m).all(axis=(1, 2))
        predicted, constant = (
            np.linalg.norm(paths_m[complete] - self.truth_m[complete], axis=2)
            for paths_m in (self.means_m, self.constant_m)
        )
        return predicted, constant

    def covered(self, probability: float) -> F64:
        """Return the share of truth inside the ellipses of a probability, H."""
        error = self.truth_m - self.means_m
        distance2 = np.einsum("khi,khij,khj->kh", error, np.linalg.inv(self.covariances_m2), error)
        known = np.isfinite(distance2)
        inside = known & (distance2 <= -2 * np.log(1 - probability))
        found: F64 = inside.sum(axis=0) / np.maximum(known.sum(axis=0), 1)
        return found

    def outcomes(self) -> npt.NDArray[np.int64]:
        """Return the true outcome (K): 0 standing, 1 going on, 2 turning, -1 unknown."""
        at = int(np.argmin(np.abs(self.horizons_s - MOTION_S)))
        moved = self.truth_m[:, at] - self.positions_m
        distance = np.hypot(*moved.T)
        speed = np.hypot(*self.velocities_mps.T)
        along = (moved * self.velocities_mps).sum(axis=1)
        ahead = along > np.cos(GOING_ON_RAD) * distance * speed
        found = np.where(distance < STANDING_M, 0, np.where(ahead, 1, 2))
        return np.where(np.isfinite(distance), found, -1)


def predict_walks(
    walks: Walks, config: PredictorConfig, history_min: int = 2
) -> tuple[PredictionPairs, list[Predictions]]:
    """Predict each person from annotation number `history_min` on.

    Constant velocity is the displacement since the previous annotation.
    """
    predicted = predict(walks, config)
    people, times_s = predicted.people, predicted.horizons_s
    truth_m, velocities_mps = walks.followed(times_s)
    history = walks.history()
    rows = np.array([row for row in people if history[row] >= history_min])
    found = [people[row] for row in rows]
    ahead_m = times_s[:, None] * velocities_mps[rows, None]
    positions_m = walks.positions_m[rows]
    pairs = pairs_of(times_s, found, positions_m[:, None] + ahead_m, truth_m[rows])
    return pairs, predicted.messages


def pairs_of(
    horizons_s: F64, people: Sequence[PersonPrediction], constant_m: F64, truth_m: F64
) -> PredictionPairs:
    """Return predictions of K people, with constant velocity and truth (KxHx2)."""
    return PredictionPairs(
        horizons_s=horizons_s,
        means_m=np.array([one.means_m for one in people]),
        covariances_m2=np.array([one.covariances_m2 for one in people]),
        constant_m=constant_m,
        truth_m=truth_m,
        positions_m=np.array([one.position_m[:2] for one in people]),
        velocities_mps=np.array([one.velocity_mps for one in people]),
        motion=np.array(
            [(m.standing, m.going_on, m.turning) for m in (one.motion for one in people)]
        ),
    )


def predict_tracks(
    tracks: Iterable[Tracks],
    truth_m: Mapping[int, Mapping[str, F64]],
    config: PredictorConfig,
    match_m: float = 0.5,
) -> PredictionPairs:
    """Predict published tracks, and compare with the true paths of the nearest people.

    Args:
        tracks: Tracks of a recording, in order.
        truth_m: True positions (2) of people by id, by stamp [ns].
        config: Configuration of the predictor.
        match_m: Maximum distance of a track from its person [m].

    Returns:
        Predictions and truth; constant velocity is the velocity of the track.
    """
    node = build(config)
    stamps_ns = np.array(sorted(truth_m))
    names = sorted({name for people in truth_m.values() for name in people})
    unknown = np.full(2, np.nan)
    paths_m = np.array([[truth_m[s].get(n, unknown) for n in names] for s in stamps_ns.tolist()])
    times_s = (stamps_ns - stamps_ns[0]) / 1e9
    people, constant_m, followed_m = [], [], []
    horizons_s = np.zeros(0)
    for message in tracks:
        by_id = {track.id: track for track in message.tracks}
        now = int(np.searchsorted(stamps_ns, message.stamp_ns))
        for answer in node.handle(message, 0):
            assert isinstance(answer, Predictions)
            horizons_s = np.array(answer.horizons_s)
            for person in answer.people:
                distance = np.hypot(*(paths_m[now] - person.position_m[:2]).T)
                distance = np.where(np.isnan(distance), np.inf, distance)
                nearest = int(distance.argmin())
                if distance[nearest] > match_m:
                    continue
                path_m = paths_m[:, nearest]
                wanted_s = times_s[now] + horizons_s
                after_m = np.stack([np.interp(wanted_s, times_s, x) for x in path_m.T], axis=1)
                after_m[wanted_s > times_s[-1]] = np.nan
                people.append(person)
                followed_m.append(after_m)
                velocity_mps = by_id[person.id].velocity_mps[:2]
                constant_m.append(person.position_m[:2] + horizons_s[:, None] * velocity_mps)
    return pairs_of(horizons_s, people, np.array(constant_m), np.array(followed_m))


@dataclass(frozen=True)
class GroupScores:
    """Precision and recall of pairs of people in one group."""

    frame_precision: float  # pairs in single frames
    frame_recall: float
    pair_precision: float  # pairs counted once, if together in most of their frames
    pair_recall: float


def score_groups(walks: Walks, messages: Iterable[Predictions]) -> GroupScores:
    """Compare predicted groups with annotated ones; pairs share four frames or more."""
    shared: Counter[frozenset[int]] = Counter()
    together: Counter[frozenset[int]] = Counter()
    for message in messages:
        for one, other in combinations(message.people, 2):
            pair = frozenset((one.id, other.id))
            shared[pair] += 1
            together[pair] += one.group is not None and one.group == other.group
    true = {pair for pair in walks.groups if shared[pair]}
    hits = sum(together[pair] for pair in true)
    frequent = {pair for pair, count in shared.items() if count > 3}
    found = {pair for pair in frequent if together[pair] > shared[pair] / 2}
    return GroupScores(
        frame_precision=hits / max(together.total(), 1),
        frame_recall=hits / max(sum(shared[pair] for pair in true), 1),
        pair_precision=len(found & true) / max(len(found), 1),
        pair_recall=len(found & true) / max(len(true & frequent), 1),
    )


def _mean_distance(error_m: F64) -> F64:
    found: F64 = np.nanmean(np.linalg.norm(error_m, axis=2), axis=0)
    return found
