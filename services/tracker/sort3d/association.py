"""Association of tracks and detections: distances, gates and the assignment.

Rows of a cost matrix are tracks, columns detections; +inf marks an inadmissible pair.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from scipy.optimize import linear_sum_assignment

from people4d.messages import F64
from services.tracker.interface import Measurement
from services.tracker.motion.track_record import TrackRecord

T = TypeVar("T")
D = TypeVar("D")


@dataclass(frozen=True, slots=True)
class RoundMatches(Generic[T, D]):
    """The result of one round of association."""

    cost: F64  # NxM, +inf for inadmissible pairs
    tracks: Sequence[T]  # N
    detections: Sequence[D]  # M
    matches: list[tuple[T, D]]
    unmatched_tracks: list[T]
    unmatched_detections: list[D]


def assign(cost: F64) -> list[tuple[int, int]]:
    """Match as many admissible pairs as possible at the minimum sum of costs (Hungarian method).

    Args:
        cost: NxM, +inf for inadmissible pairs.

    Returns:
        Matched pairs (row, column), ordered by row.
    """
    if not cost.size:
        return []
    admissible = np.isfinite(cost)
    costs = cost[admissible]
    if not costs.size:
        return []
    least = costs.min()
    # Above the sum of all pairs: dropping an admissible pair never lowers the cost.
    forbidden = (costs.max() - least + 1.0) * (min(cost.shape) + 1)
    rows, columns = linear_sum_assignment(np.where(admissible, cost - least, forbidden))
    chosen = admissible[rows, columns]
    return list(zip(rows[chosen].tolist(), columns[chosen].tolist(), strict=True))


def associate(cost: F64, tracks: Sequence[T], detections: Sequence[D]) -> RoundMatches[T, D]:
    """Match tracks (N) and detections (M) at the minimum sum of costs (NxM), see `assign`."""
    pairs = assign(cost)
    rows, columns = {i for i, _ in pairs}, {j for _, j in pairs}
    return RoundMatches(
        cost,
        tracks,
        detections,
        matches=[(tracks[i], detections[j]) for i, j in pairs],
        unmatched_tracks=[track for i, track in enumerate(tracks) if i not in rows],
        unmatched_detections=[d for j, d in enumerate(detections) if j not in columns],
    )


def distances(a_m: F64, b_m: F64) -> F64:
    """Return the Euclidean distance (NxM, metres) of each of N points to each of M points."""
    gap: F64 = np.linalg.norm(a_m[:, None] - b_m[None], axis=-1)
    return gap


def min_max(values: F64) -> F64:
    """Scale values to 0 to 1; all 0 if they are equal (section 4)."""
    if not values.size:
        return values
    least = values.min()
    spread = values.max() - least
    return (values - least) / spread if spread > 0 else np.zeros_like(values)


def adaptive_gate(previous_m: F64, sigmas: float = 1.6) -> float:
    """Return tau = mu + 1.6 sigma of all distances (m) in the previous frame (section 4).

    Infinity if the previous frame had no pair.
    """
    return float(previous_m.mean() + sigmas * previous_m.std()) if previous_m.size else np.inf


def cosine_distances(
    a: Sequence[TrackRecord | Measurement], b: Sequence[TrackRecord | Measurement]
) -> F64:
    """Return 1 - a.b (NxM, 0 to 2) of the embeddings of each pair, NaN where one is unknown."""
    known = [one.embedding for one in (*a, *b) if one.embedding is not None]
    unknown = np.full(len(known[0]) if known else 1, np.nan)
    rows = [unknown if one.embedding is None else one.embedding for one in (*a, *b)]
    vectors = np.array(rows).reshape(-1, len(unknown))
    apart: F64 = 1.0 - vectors[: len(a)] @ vectors[len(a) :].T
    return np.asarray(np.minimum(np.maximum(apart, 0.0), 2.0))
