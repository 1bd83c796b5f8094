"""StrongSORT-3D: 3D positions and appearance, two assignments (method book section 5)."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from people4d.messages import F64, Track
from services.tracker import state
from services.tracker.config import StrongSort3dConfig, TrackerConfig
from services.tracker.identity.recognition import Recognition, Sight
from services.tracker.interface import Measurement, Need, Observation, in_order
from services.tracker.motion import kalman
from services.tracker.motion.motion import PointMotion
from services.tracker.motion.population import Population, Survival, Target, stack
from services.tracker.motion.standing import StandOrWalk
from services.tracker.motion.yaw import make_yaw
from services.tracker.sort3d import association
from services.tracker.strongsort3d.base_drift import BaseDrift
from services.tracker.strongsort3d.contact import (
    BOOL,
    Scene,
    cut_off,
    doubted,
    in_the_open,
    indistinct,
    out_of_reach,
    scene,
    strangers,
)
from services.tracker.strongsort3d.occlusion import Fading, hidden
from services.tracker.strongsort3d.watching import mark_unwatched, mark_watched

ROUND_2 = 0.5  # certainty of a match for no other reason than that somebody is near
Pairs = list[tuple[Target, Measurement]]


class StrongSort3d:
    """StrongSORT with the 3D position as its state.

    Without embeddings round 1 goes by motion alone, see `combined_cost`. What `occlusion`,
    `contact` and `identity` of the configuration add is not of the paper, and off unless asked for.
    """

    needs: ClassVar[frozenset[Need]] = frozenset({Need.EMBEDDINGS})

    def __init__(self, config: TrackerConfig) -> None:
        self._config = config.strongsort3d
        self._motion = PointMotion(self._config)
        occlusion, identity = self._config.occlusion, self._config.identity
        survival = Survival(
            # Who somebody is, is asked before they are told, at their second sight at the earliest.
            confirm_hits=max(self._config.n_init, 2 if identity.enabled else 1),
            tentative_frames=1,
            lost_frames=self._config.a_max,
            lost_s=config.max_lost_s,
        )
        fading = Fading(occlusion, self._motion.velocity) if occlusion.enabled else None
        standing = self._config.standing
        paces = StandOrWalk(self._motion, standing, fading) if standing.enabled else None
        self._people = Population(self._motion, survival, make_yaw(config), fading, paces)
        self._recognition = Recognition(identity, self._people) if identity.enabled else None
        self.identities = self._people.identities
        self._drift = BaseDrift(config.base)
        self._embedder = ("", 0)

    def update(self, observation: Observation) -> list[Track]:
        """Predict, assign twice, correct; begin and end tracks."""
        people, occlusion = self._people, self._config.occlusion
        elapsed_ns = observation.stamp_ns - (people.stamp_ns or observation.stamp_ns)
        people.advance(observation)
        self._doubt_drift(observation)
        if occlusion.enabled:
            mark_unwatched(people.targets, observation, elapsed_ns, occlusion)
        detections = in_order(observation.measurements)
        if self._config.contact.enabled:
            detections = doubted(detections, observation, self._config.contact)
        self._forget_other_embedder(observation)
        confirmed = [t for t in people.targets if t.confirmed and not self._left(t, observation)]
        tentative = [t for t in people.targets if not t.confirmed]
        now = scene(observation, self._positions_m(confirmed), self._config)

        cost = self._appearance_cost(confirmed, detections, now)
        miss = now.c_cos if self._config.contact.enabled else np.inf
        first, missed, rest = association.associate(cost, confirmed, detections, miss)
        certain = self._certain(cost, confirmed, detections)
        recent = [t for t in missed if t.missed <= 1]
        cost = self._distance_cost(recent + tentative, rest, now)
        second, _, new = association.associate(cost, recent + tentative, rest)

        people.match(first + second, observation)
        self._update_embeddings(first + second, now)
        if occlusion.enabled:
            mark_watched([t for t, _ in first + second], observation, occlusion)
        self._mark_hidden(observation)
        if self._recognition:
            mark_at_edge(first + second, observation)
            sights = [
                Sight(t, m, m.index not in now.unclear, certain.get((t.id, m.index), ROUND_2))
                for t, m in first + second
            ]
            self._recognition.update(sights, now)
        return people.finish(new, observation)

    def predict(self, stamp_ns: int) -> list[Track]:
        """Return the tracks as they should be at a later time."""
        return self._people.predicted(stamp_ns)

    def reset(self) -> None:
        """Forget all people and times, but not which identities were given."""
        self._people.clear()
        self._drift.clear()
        if self._recognition:
            self._recognition.clear()

    def save(self) -> bytes:
        """Return all that is known of people."""
        gallery = self._recognition.gallery if self._recognition else None
        return state.save("strongsort3d", self._people, self._embedder, gallery)

    def restore(self, saved: bytes) -> None:
        """Go on with what another process saved."""
        gallery = self._recognition.gallery if self._recognition else None
        self._embedder = state.restore("strongsort3d", self._people, saved, gallery)

    def postpone(self, duration_ns: int) -> None:
        """Take a time as not passed, since nobody looked."""
        self._people.postpone(duration_ns)

    def _doubt_drift(self, observation: Observation) -> None:
        """Doubt where people are as far as the base that carries the camera may have erred."""
        doubts_m2 = self._drift.since_last(observation, self._positions_m(self._people.targets))
        if doubts_m2 is not None:
            self._people.doubt(doubts_m2, observation.camera)

    def _left(self, target: Target, observation: Observation) -> bool:
        """Tell whether it is up to recognition to find a person again."""
        identity = self._config.identity
        if not identity.enabled or target.hidden or target.embedding is None:
            return False
        missed_s = (observation.stamp_ns - target.seen_ns - target.unwatched_ns) / 1e9
        return missed_s > (identity.leaving_s if target.at_edge else identity.handover_s)

    def _appearance_cost(
        self, targets: Sequence[Target], detections: Sequence[Measurement], now: Scene
    ) -> F64:
        """Return the cost of round 1."""
        config, motion = self._config, self._motion
        if not targets or not detections:
            return np.full((len(targets), len(detections)), np.inf)
        z, R = motion.measure(detections), motion.gate_noise(detections)
        d_m2 = kalman.gating_distances(*stack(targets), z, motion.H, R)
        d_cos = cosine_distances(targets, detections)
        if config.contact.enabled:
            looks = [t.embedding for t in targets]
            own = association.cosine_distances(looks, looks)
            d_cos = indistinct(d_cos, own, config.contact.alike_factor * now.c_cos)
            d_cos[:, ~now.clear(detections)] /= config.contact.unclear_factor
            d_cos[:, ~now.single(detections)] /= config.contact.crowded_factor
            d_m2[self._out_of_reach(targets, detections, now)] = np.inf
        return combined_cost(d_m2, d_cos, now.c_cos, config)

    def _distance_cost(
        self, targets: Sequence[Target], detections: Sequence[Measurement], now: Scene
    ) -> F64:
        """Return the cost of round 2: the 3D distance."""
        config = self._config
        if not targets or not detections:
            return np.full((len(targets), len(detections)), np.inf)
        z, (x, _) = self._motion.measure(detections), stack(targets)
        cost = association.distances(x[:, self._motion.position], z)
        cost[cost > config.distance_max_m] = np.inf
        if config.contact.enabled:
            d_cos, clear = cosine_distances(targets, detections), now.clear(detections)
            limit = config.contact.round2_factor * now.c_cos
            cost[strangers(targets, d_cos, clear, limit)] = np.inf
            cost[self._out_of_reach(targets, detections, now)] = np.inf
        return cost

    def _out_of_reach(
        self, targets: Sequence[Target], detections: Sequence[Measurement], now: Scene
    ) -> BOOL:
        config, tracks_m = self._config, self._positions_m(targets)
        unseen_s = np.array([now.observation.stamp_ns - t.seen_ns for t in targets]) / 1e9
        far = out_of_reach(tracks_m, unseen_s, detections, config.contact)
        return far | in_the_open(targets, tracks_m, detections, now, config)

    def _positions_m(self, targets: Sequence[Target]) -> F64:
        return np.array([t.x[self._motion.position] for t in targets]).reshape(-1, 3)

    def _certain(
        self, cost: F64, targets: Sequence[Target], detections: Sequence[Measurement]
    ) -> dict[tuple[int, int], float]:
        """Return by track and index of the detection how certain a match of round 1 is."""
        if self._recognition is None or not cost.size:
            return {}
        share = association.certainties(cost, self._config.identity.temperature)
        return {
            (t.id, m.index): float(share[i, j])
            for i, t in enumerate(targets)
            for j, m in enumerate(detections)
        }

    def _mark_hidden(self, observation: Observation) -> None:
        """Count, for whom this frame missed, that somebody stood before them."""
        people = [t for t in self._people.targets if t.confirmed]
        if not self._config.occlusion.enabled or observation.map_from_camera is None or not people:
            return
        seen = np.array([t.detection is not None for t in people])
        behind = hidden(
            self._positions_m(people), seen, observation.map_from_camera, self._config.occlusion
        )
        for target, is_hidden in zip(people, behind, strict=True):
            if is_hidden and target.camera == observation.camera:
                target.hidden += 1
                target.hidden_ns = observation.stamp_ns

    def _update_embeddings(self, pairs: Pairs, now: Scene) -> None:
        skipped = now.unclear if self._config.contact.enabled else frozenset[int]()
        for target, measurement in pairs:
            if measurement.embedding is None:
                continue
            if target.embedding is None or measurement.index not in skipped:
                target.embedding = moving_average(
                    target.embedding, measurement.embedding, self._alpha(target)
                )

    def _alpha(self, target: Target) -> float:
        """Return alpha of section 5; with contact the first pictures all count alike."""
        alpha, first = self._config.ema_alpha, 1.0 - 1.0 / target.hits
        return min(alpha, first) if self._config.contact.enabled else alpha

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
            if self._recognition:
                self._recognition.clear()


def mark_at_edge(pairs: Pairs, observation: Observation) -> None:
    """Note who is cut off at the left or right of the image: if they vanish, they left."""
    boxes = np.array([m.box_xyxy_px for _, m in pairs], np.float64).reshape(-1, 4)
    for (target, _), is_cut in zip(pairs, cut_off(boxes, observation.size_px), strict=True):
        target.at_edge = bool(is_cut)


def cosine_distances(targets: Sequence[Target], detections: Sequence[Measurement]) -> F64:
    """Return the cosine distance (NxM) of tracks and detections, NaN where one is unknown."""
    return association.cosine_distances(
        [t.embedding for t in targets], [m.embedding for m in detections]
    )


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
