"""Policies around StrongSORT-3D: each base class does nothing and leaves the published method."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from people4d.messages import F64
from services.tracker.config import StrongSort3dConfig
from services.tracker.identity.gallery import GalleryEntry
from services.tracker.interface import Measurement, Observation
from services.tracker.motion.track_record import BOOL, TrackRecord
from services.tracker.motion.track_set import TrackSet
from services.tracker.sort3d.association import RoundMatches
from services.tracker.strongsort3d import visibility

Match = tuple[TrackRecord, Measurement]


@dataclass(frozen=True)
class FrameContext:
    """One frame with all that association uses beside the states of the tracks."""

    observation: Observation
    detections: Sequence[Measurement]  # in an order that does not depend on their arrival
    tracks_m: F64  # Nx3, predicted positions of the confirmed tracks
    config: StrongSort3dConfig

    @cached_property
    def cosine_distance_max(self) -> float:
        """C_cos of the frame's embedder."""
        return self.config.cosine_limit(self.observation.embedder)

    @cached_property
    def overlapping(self) -> frozenset[int]:
        """Indices of the detections that could belong to several tracks in one line of sight."""
        pose, config = self.observation.map_from_camera, self.config
        if pose is None:
            return frozenset()
        found_m = np.array([m.position_m for m in self.detections]).reshape(-1, 3)
        half_m = config.occlusion.half_width_m
        found, _ = visibility.intervals(found_m, pose, half_m)
        tracks, depth_m = visibility.intervals(self.tracks_m, pose, half_m)
        tracks = tracks[depth_m > visibility.NEAR_M]
        return self._indices(visibility.overlapping(found, tracks, config.contact.overlap_min))

    @cached_property
    def occluded(self) -> frozenset[int]:
        """Indices of the detections whose crop shows others, too, or is cut off."""
        boxes = np.array([m.box_xyxy_px for m in self.detections], np.float64).reshape(-1, 4)
        bad = visibility.covered_ratios(boxes) > self.config.contact.covered_max
        bad |= visibility.cut_off(boxes, self.observation.size_px)
        return self.overlapping | self._indices(bad)

    def _indices(self, chosen: BOOL) -> frozenset[int]:
        pairs = zip(self.detections, chosen, strict=True)
        return frozenset(detection.index for detection, is_chosen in pairs if is_chosen)


@dataclass(frozen=True, slots=True)
class CandidatePairs:
    """The tracks (N) and detections (M) of one round of association."""

    records: Sequence[TrackRecord]
    detections: Sequence[Measurement]
    tracks_m: F64  # Nx3, predicted positions
    frame: FrameContext

    def unoccluded(self) -> BOOL:
        """Return the detections (M) whose crop shows one person only."""
        return np.array([m.index not in self.frame.occluded for m in self.detections], np.bool_)

    def separate(self) -> BOOL:
        """Return the detections (M) that could belong to one track at most."""
        return np.array([m.index not in self.frame.overlapping for m in self.detections], np.bool_)


@dataclass(frozen=True, slots=True)
class AssociationResult:
    """Both rounds of association of a frame."""

    frame: FrameContext
    by_appearance: RoundMatches[TrackRecord, Measurement]
    by_distance: RoundMatches[TrackRecord, Measurement]

    @property
    def matches(self) -> list[Match]:
        """All matches."""
        return self.by_appearance.matches + self.by_distance.matches


class TrackPolicy:
    """Changes of tracks between the steps of the algorithm; this base changes nothing."""

    def after_prediction(self, tracks: TrackSet, observation: Observation) -> None:
        """Change predicted tracks."""

    def after_update(self, tracks: TrackSet, result: AssociationResult) -> None:
        """Change tracks after the update."""

    def clear(self) -> None:
        """Drop the policy's own state."""


class ContactPolicy:
    """Association of people who touch or cross; this base leaves the published method."""

    def prepare(self, observation: Observation, detections: list[Measurement]) -> list[Measurement]:  # noqa: ARG002
        """Return detections with the covariance to add to each."""
        return detections

    def miss_cost(self, frame: FrameContext) -> float:  # noqa: ARG002
        """Return the cost of an unmatched track in round 1."""
        return np.inf

    def appearance(self, d_cos: F64, pairs: CandidatePairs) -> F64:  # noqa: ARG002
        """Return the cosine distances (NxM, NaN where unknown) of round 1."""
        return d_cos

    def unreachable(self, pairs: CandidatePairs) -> BOOL:
        """Return the pairs (NxM) that are too far apart."""
        return np.zeros((len(pairs.records), len(pairs.detections)), np.bool_)

    def mismatch(self, d_cos: F64, pairs: CandidatePairs) -> BOOL:  # noqa: ARG002
        """Return the pairs (NxM) that round 2 must refuse by their cosine distances."""
        return np.zeros(d_cos.shape, np.bool_)

    def updates_embedding(self, match: Match, frame: FrameContext) -> bool:  # noqa: ARG002
        """Check that a match may change the embedding of its track."""
        return True

    def alpha(self, alpha: float, record: TrackRecord) -> float:  # noqa: ARG002
        """Return the weight of a track's embedding in its moving average."""
        return alpha


class IdentityPolicy(TrackPolicy):
    """Re-identification of people who return; this base does none."""

    def is_absent(self, record: TrackRecord, observation: Observation) -> bool:  # noqa: ARG002
        """Check that a track is left to re-identification instead of association."""
        return False

    def entries(self) -> list[tuple[int, GalleryEntry]]:
        """Return the gallery for a checkpoint."""
        return []

    def restore(self, entries: list[tuple[int, GalleryEntry]]) -> None:
        """Continue with the gallery of a checkpoint."""


@dataclass(frozen=True, slots=True)
class Policies:
    """All policies of one tracker."""

    contact: ContactPolicy = field(default_factory=ContactPolicy)
    identity: IdentityPolicy = field(default_factory=IdentityPolicy)
    tracks: tuple[TrackPolicy, ...] = ()  # applied in this order, before `identity`

    @property
    def in_order(self) -> tuple[TrackPolicy, ...]:
        """All policies of tracks."""
        return (*self.tracks, self.identity)
