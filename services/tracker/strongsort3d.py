"""StrongSORT-3D: 3D positions and appearance, two assignments (method book section 5)."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from common.messages import F64, Track
from services.tracker import association, kalman
from services.tracker.config import StrongSort3dConfig, TrackerConfig
from services.tracker.interface import Measurement, Need, Observation, in_order
from services.tracker.motion import PointMotion
from services.tracker.population import Population, Survival, Target, stack
from services.tracker.yaw import make_yaw

Pairs = list[tuple[Target, Measurement]]


class StrongSort3d:
    """StrongSORT with the 3D position as its state.

    Without embeddings round 1 goes by motion alone, see `combined_cost`.
    """

    needs: ClassVar[frozenset[Need]] = frozenset({Need.EMBEDDINGS})

    def __init__(self, config: TrackerConfig) -> None:
        self._config = config.strongsort3d
        self._motion = PointMotion(self._config)
        survival = Survival(
            confirm_hits=self._config.n_init,
            tentative_frames=1,
            lost_frames=self._config.a_max,
            lost_s=config.max_lost_s,
        )
        self._people = Population(self._motion, survival, make_yaw(config))
        self._embedder = ("", 0)

    def update(self, observation: Observation) -> list[Track]:
        """Predict, assign twice, correct; begin and end tracks."""
        people = self._people
        people.advance(observation)
        detections = in_order(observation.measurements)
        self._forget_other_embedder(observation)
        confirmed = [t for t in people.targets if t.confirmed]
        tentative = [t for t in people.targets if not t.confirmed]

        cost = self._appearance_cost(confirmed, detections, observation.embedder)
        first, missed, rest = association.associate(cost, confirmed, detections)
        recent = [t for t in missed if t.missed <= 1]
        cost = self._distance_cost(recent + tentative, rest)
        second, _, new = association.associate(cost, recent + tentative, rest)

        people.match(first + second, observation)
        self._update_embeddings(first + second)
        return people.finish(new, observation)

    def predict(self, stamp_ns: int) -> list[Track]:
        """Return the tracks as they should be at a later time."""
        return self._people.predicted(stamp_ns)

    def reset(self) -> None:
        """Forget all people and times, but not which identities were given."""
        self._people.clear()

    def _appearance_cost(
        self, targets: Sequence[Target], detections: Sequence[Measurement], embedder: str
    ) -> F64:
        """Return the cost of round 1."""
        config, motion = self._config, self._motion
        if not targets or not detections:
            return np.full((len(targets), len(detections)), np.inf)
        z, R = motion.measure(detections), motion.gate_noise(detections)
        d_m2 = kalman.gating_distances(*stack(targets), z, motion.H, R)
        d_cos = association.cosine_distances(
            [t.embedding for t in targets], [m.embedding for m in detections]
        )
        return combined_cost(d_m2, d_cos, config.cosine_limit(embedder), config)

    def _distance_cost(self, targets: Sequence[Target], detections: Sequence[Measurement]) -> F64:
        """Return the cost of round 2: the 3D distance."""
        if not targets or not detections:
            return np.full((len(targets), len(detections)), np.inf)
        x, _ = stack(targets)
        cost = association.distances(x[:, self._motion.position], self._motion.measure(detections))
        cost[cost > self._config.distance_max_m] = np.inf
        return cost

    def _update_embeddings(self, pairs: Pairs) -> None:
        for target, measurement in pairs:
            if measurement.embedding is not None:
                target.embedding = moving_average(
                    target.embedding, measurement.embedding, self._config.ema_alpha
                )

    def _forget_other_embedder(self, observation: Observation) -> None:
        """Drop the embeddings of another model or length: they do not compare."""
        lengths = {len(m.embedding) for m in observation.measurements if m.embedding is not None}
        if not lengths:
            return
        embedder = (observation.embedder, lengths.pop())
        if lengths:
            raise ValueError(f"embeddings: expected one length, got {lengths | {embedder[1]}}")
        if embedder != self._embedder:
            self._embedder = embedder
            for target in self._people.targets:
                target.embedding = None


def combined_cost(d_m2: F64, d_cos: F64, c_cos: float, config: StrongSort3dConfig) -> F64:
    """Return lambda d_M^2 + (1 - lambda) d_cos, infinite outside the gates (section 5).

    Where a track or a detection has no embedding, d_cos = C_cos d_M^2 / d_M,max^2 stands in: a pair
    at the edge of the motion gate costs as much as one at the edges of both.

    Args:
        d_m2: NxM squared Mahalanobis distances.
        d_cos: NxM cosine distances, NaN where unknown.
        c_cos: Largest cosine distance.
        config: lambda and the motion gate.
    """
    d_cos = np.where(np.isnan(d_cos), c_cos * d_m2 / config.mahalanobis_max, d_cos)
    cost: F64 = config.motion_weight * d_m2 + (1 - config.motion_weight) * d_cos
    cost[(d_m2 > config.mahalanobis_max) | (d_cos > c_cos)] = np.inf
    return cost


def moving_average(e: F64 | None, f: F64, alpha: float) -> F64:
    """Return alpha e + (1 - alpha) f at unit length; f if e is unknown or the sum vanishes."""
    mixed = f if e is None else alpha * e + (1 - alpha) * f
    length = float(np.linalg.norm(mixed))
    return mixed / length if length > 1e-6 else f
