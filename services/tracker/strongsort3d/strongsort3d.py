"""StrongSORT-3D: 3D positions and appearance, two assignments (docs/method.md, section 5).

The algorithm follows [PIC4SeR]; all extensions are `Policies` around it.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import msgspec
import numpy as np

from people4d.messages import F64, Track
from services.tracker.areas.interface import AreaTracker, KnownPeople
from services.tracker.interface import GalleryEntry, Measurement, Observation, in_order
from services.tracker.motion.motion import PositionMotion
from services.tracker.motion.track_record import IdentityDecision, TrackRecord, stack
from services.tracker.motion.track_set import TrackSet
from services.tracker.sort3d.association import associate, cosine_distances, distances
from services.tracker.stateful import TrackerCheckpoint, TrackSetTracker
from services.tracker.strongsort3d.config import StrongSort3dConfig
from services.tracker.strongsort3d.policies import (
    AssociationResult,
    FrameContext,
    Match,
    Policies,
)

MOTION_WEIGHT = 0.02  # lambda in c = lambda d_M^2 + (1 - lambda) d_cos [Du 2023]
CHI2_3DOF_95 = 7.8147  # maximum d_M^2 of a pair: chi^2, 3 degrees of freedom, 95 % [PIC4SeR]
EMA_ALPHA = 0.9  # alpha in e <- alpha e + (1 - alpha) f [Du 2023]
LENGTH_MIN = 1e-6  # minimum length of a usable mean embedding


class StrongSort3d(TrackSetTracker, AreaTracker):
    """StrongSORT with the 3D position as its state.

    Without embeddings round 1 matches by motion alone, see `combined_cost`.
    """

    uses_embeddings: ClassVar[bool] = True

    def __init__(
        self,
        config: StrongSort3dConfig,
        motion: PositionMotion,
        tracks: TrackSet,
        policies: Policies,
    ) -> None:
        super().__init__(tracks)
        self._config, self._motion, self._policies = config, motion, policies
        self._embedder = ("", 0)

    def update(self, observation: Observation) -> list[Track]:
        """Predict, associate in two rounds, update, and manage the life of the tracks."""
        tracks, policies = self.tracks, self._policies
        tracks.predict(observation)
        for policy in policies.of_tracks:
            policy.after_prediction(tracks, observation)
        self._drop_other_embeddings(observation)
        result = self._associate(observation)
        tracks.update(result.matches, observation)
        update_embeddings(result.matches, EMA_ALPHA)
        for policy in policies.of_tracks:
            policy.after_update(tracks, result)
        return tracks.manage(result.by_distance.unmatched_detections, observation)

    def reset(self) -> None:
        """Delete all tracks and times; identities are not reused."""
        super().reset()
        for policy in self._policies.of_tracks:
            policy.clear()

    def known_people(self) -> KnownPeople | None:
        """Return the gallery; None if re-identification is off."""
        identity = self._policies.identity
        return (
            KnownPeople(self._embedder[0], dict(identity.entries()))
            if identity.recognises
            else None
        )

    def learn_neighbours(self, people: Mapping[int, GalleryEntry]) -> None:
        """Replace the people of neighbouring areas whose views are comparable."""
        length = self._embedder[1]
        known = {i: e for i, e in people.items() if all(len(v) == length for v in e.views)}
        self._policies.identity.learn_neighbours(known)

    def rename(self, identities: Mapping[int, int | None]) -> None:
        """Change tracks to the identities of neighbours; None: a new identity."""
        given = {to for to in identities.values() if to is not None}
        self.tracks.end(given)  # lost tracks of the same people
        for record in self.tracks.records:
            if record.id not in identities:
                continue
            before, identity = record.id, identities[record.id]
            if identity is None:
                record.id = self.ids.new()
                record.identity = IdentityDecision("new", 0.5, "the identity is tracked elsewhere")
            else:
                record.id = identity
                record.identity = IdentityDecision("continued", 0.9, "tracked by a neighbour")
            self._policies.identity.rename(before, identity)

    def checkpoint(self) -> TrackerCheckpoint:
        """Return the state."""
        gallery = self._policies.identity.entries()
        return msgspec.structs.replace(
            super().checkpoint(), embedder=self._embedder, gallery=gallery
        )

    def restore_checkpoint(self, state: TrackerCheckpoint) -> None:
        """Continue from a state."""
        super().restore_checkpoint(state)
        self._embedder = state.embedder
        self._policies.identity.restore(state.gallery)

    def _associate(self, observation: Observation) -> AssociationResult:
        """Match confirmed tracks by motion and appearance, then others by distance."""
        records = self.tracks.records
        tentative = [t for t in records if not t.confirmed]
        frame = FrameContext(observation, in_order(observation.measurements), self._config)

        cost = self._appearance_cost(self.tracks.confirmed, frame)
        first = associate(cost, self.tracks.confirmed, frame.detections)
        recent = [t for t in first.unmatched_tracks if t.frames_missed <= 1] + tentative
        rest = first.unmatched_detections
        second = associate(self._distance_cost(recent, rest), recent, rest)
        return AssociationResult(frame, first, second)

    def _appearance_cost(self, records: Sequence[TrackRecord], frame: FrameContext) -> F64:
        motion, detections = self._motion, frame.detections
        if not records or not detections:
            return np.full((len(records), len(detections)), np.inf)
        (x, P), R = stack(records), motion.gate_noise(detections)
        d_cos = cosine_distances(records, detections)
        d_m2 = self._policies.visibility.gate(x, P, R, d_cos, frame)
        return combined_cost(d_m2, d_cos, frame.cosine_distance_max)

    def _distance_cost(
        self, records: Sequence[TrackRecord], detections: Sequence[Measurement]
    ) -> F64:
        if not records or not detections:
            return np.full((len(records), len(detections)), np.inf)
        cost = distances(self.tracks.positions_m(records), self._motion.measure(detections))
        cost[cost > self._config.distance_max_m] = np.inf
        return cost

    def _drop_other_embeddings(self, observation: Observation) -> None:
        """Drop embeddings of another model or length, which are not comparable."""
        embedder = embedder_of(observation)
        if embedder is None or embedder == self._embedder:
            return
        self._embedder = embedder
        for record in self.tracks.records:
            record.embedding = None
        self._policies.identity.clear()


def combined_cost(d_m2: F64, d_cos: F64, c_cos: float) -> F64:
    """Return lambda d_M^2 + (1 - lambda) d_cos (NxM), infinite outside the gates.

    If a track or a detection has no embedding (d_cos is NaN), d_cos is C_cos d_M^2 / d_M,max^2: at
    the edge of the motion gate it is C_cos.
    """
    unknown = np.isnan(d_cos)
    if unknown.any():
        d_cos = np.where(unknown, c_cos * d_m2 / CHI2_3DOF_95, d_cos)
    cost: F64 = MOTION_WEIGHT * d_m2 + (1 - MOTION_WEIGHT) * d_cos
    cost[(d_m2 > CHI2_3DOF_95) | (d_cos > c_cos)] = np.inf
    return cost


def embedder_of(observation: Observation) -> tuple[str, int] | None:
    """Return name and length of a frame's embeddings; None if there are none.

    Raises:
        ValueError: The lengths differ.
    """
    lengths = {len(m.embedding) for m in observation.measurements if m.embedding is not None}
    if len(lengths) > 1:
        raise ValueError(f"embeddings: expected one length, got {lengths}")
    return (observation.embedder, lengths.pop()) if lengths else None


def update_embeddings(matches: Sequence[Match], alpha: float) -> None:
    """Update the embeddings of matched tracks: e <- alpha e + (1 - alpha) f."""
    known = [(record, m.embedding) for record, m in matches if m.embedding is not None]
    if not known:
        return
    f = np.array([embedding for _, embedding in known])
    e = np.array([f_k if record.embedding is None else record.embedding for record, f_k in known])
    for (record, _), mean in zip(known, moving_averages(e, f, alpha), strict=True):
        record.embedding = mean


def moving_averages(e: F64, f: F64, alpha: float) -> F64:
    """Return alpha e + (1 - alpha) f (Nxd) at unit length; f where the sum vanishes."""
    mixed = alpha * e + (1 - alpha) * f
    lengths = np.sqrt(np.einsum("ij,ij->i", mixed, mixed))[:, None]
    result: F64 = np.where(lengths > LENGTH_MIN, mixed / np.maximum(lengths, LENGTH_MIN), f)
    return result
