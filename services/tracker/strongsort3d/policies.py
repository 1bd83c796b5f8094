"""Policies around StrongSORT-3D: each base class does nothing and leaves the published method."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from people4d.messages import F64
from services.tracker.interface import GalleryEntry, Measurement, Observation
from services.tracker.motion.track_record import BOOL, TrackRecord
from services.tracker.motion.track_set import TrackSet
from services.tracker.sort3d.association import RoundMatches
from services.tracker.strongsort3d import visibility
from services.tracker.strongsort3d.config import StrongSort3dConfig

Match = tuple[TrackRecord, Measurement]


@dataclass(frozen=True)
class FrameContext:
    """One frame with all that association uses beside the states of the tracks."""

    observation: Observation
    detections: Sequence[Measurement]  # in an order that does not depend on their arrival
    config: StrongSort3dConfig

    @cached_property
    def cosine_distance_max(self) -> float:
        """C_cos of the frame's embedder."""
        return self.config.cosine_limit(self.observation.embedder)

    @cached_property
    def positions_m(self) -> F64:
        """Measured positions, Mx3."""
        return np.array([m.position_m for m in self.detections]).reshape(-1, 3)

    @cached_property
    def cut_off(self) -> frozenset[int]:
        """Indices of the detections whose box reaches the left or right of the image."""
        return self._indices(visibility.cut_off(self._boxes, self.observation.size_px))

    @cached_property
    def depth_uncertain(self) -> frozenset[int]:
        """Indices of the detections whose depth may be that of a person in front."""
        # Not of those in front by depth alone: the depths are what is in doubt.
        covered = visibility.common_ratios(self._boxes).max(axis=1, initial=0.0)
        return self._indices(covered > self.config.contact.depth_covered_max)

    @cached_property
    def _boxes(self) -> F64:
        """Boxes of the detections, Mx4."""
        boxes = [m.box_xyxy_px for m in self.detections]
        return np.array(boxes, np.float64).reshape(-1, 4)

    def _indices(self, chosen: BOOL) -> frozenset[int]:
        pairs = zip(self.detections, chosen.tolist(), strict=True)
        return frozenset(detection.index for detection, is_chosen in pairs if is_chosen)


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

    def gate_covariances_m2(
        self,
        frame: FrameContext,  # noqa: ARG002
    ) -> F64 | None:
        """Return the covariances (Mx3x3) by which the noise of detections grows in gates, if so."""
        return None

    def alpha(self, alpha: float, record: TrackRecord) -> float:  # noqa: ARG002
        """Return the weight of a track's embedding in its moving average."""
        return alpha


class IdentityPolicy(TrackPolicy):
    """Re-identification of people who return; this base does none."""

    def is_absent(self, record: TrackRecord, observation: Observation) -> bool:  # noqa: ARG002
        """Check that a track is left to re-identification instead of association."""
        return False

    def cosine_limits(self, records: Sequence[TrackRecord], frame: FrameContext) -> F64:
        """Return the largest cosine distances (N) at which tracks match in round 1."""
        return np.full(len(records), frame.cosine_distance_max)

    def entries(self) -> list[tuple[int, GalleryEntry]]:
        """Return the gallery for a checkpoint."""
        return []

    def restore(self, entries: list[tuple[int, GalleryEntry]]) -> None:
        """Continue with the gallery of a checkpoint."""

    def learn_neighbours(self, people: Mapping[int, GalleryEntry]) -> None:
        """Take the people of neighbouring areas by identity, in place of those before."""

    def rename(self, identity: int, to: int | None) -> None:
        """Change the identity of a person of the gallery; None: delete it there."""


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
