"""Policies around StrongSORT-3D: each base class does nothing and leaves the published method."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from common import kalman
from people4d.messages import F64
from services.tracker.interface import GalleryEntry, Measurement, Observation
from services.tracker.motion.track_record import BOOL, TrackRecord
from services.tracker.motion.track_set import TrackSet
from services.tracker.sort3d.association import RoundMatches
from services.tracker.strongsort3d.config import StrongSort3dConfig

EDGE_RATIO = 0.02  # maximum distance of a cut-off box to the image border, over the image width

Match = tuple[TrackRecord, Measurement]


@dataclass(frozen=True)
class FrameContext:
    """Input of association other than the tracks."""

    observation: Observation
    detections: Sequence[Measurement]  # in a fixed order
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
    def boxes(self) -> F64:
        """Boxes of the detections, Mx4."""
        boxes = [m.box_xyxy_px for m in self.detections]
        return np.array(boxes, np.float64).reshape(-1, 4)

    @cached_property
    def cut_off(self) -> frozenset[int]:
        """Indices of the detections whose box reaches the left or right of the image."""
        pairs = zip(self.detections, cut_off(self.boxes, self.observation.size_px), strict=True)
        return frozenset(detection.index for detection, is_cut_off in pairs if is_cut_off)


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
        """Delete the state of the policy."""


class VisibilityPolicy(TrackPolicy):
    """People occluded or outside the image; this base leaves the published method."""

    def gate(
        self,
        x: F64,
        P: F64,
        R: F64,
        d_cos: F64,  # noqa: ARG002
        frame: FrameContext,
    ) -> F64:
        """Return d_M^2 (NxM) of tracks and detections.

        Args:
            x: States of the tracks, Nx6.
            P: Their covariances, Nx6x6.
            R: Noise of the detections, Mx3x3.
            d_cos: Cosine distances, NxM; NaN where unknown.
            frame: Context of the frame.
        """
        return kalman.gate(x, P, frame.positions_m, R)


class IdentityPolicy(TrackPolicy):
    """Re-identification of returning people; disabled in this base."""

    recognises: ClassVar[bool] = False  # True: returning people are re-identified

    def entries(self) -> list[tuple[int, GalleryEntry]]:
        """Return the gallery for a checkpoint."""
        return []

    def restore(self, entries: list[tuple[int, GalleryEntry]]) -> None:
        """Continue with the gallery of a checkpoint."""

    def learn_neighbours(self, people: Mapping[int, GalleryEntry]) -> None:
        """Replace the people of neighbouring areas, by identity."""

    def rename(self, identity: int, to: int | None) -> None:
        """Change the identity of a person in the gallery; None: delete the person."""


@dataclass(frozen=True, slots=True)
class Policies:
    """All policies of one tracker."""

    visibility: VisibilityPolicy = field(default_factory=VisibilityPolicy)
    identity: IdentityPolicy = field(default_factory=IdentityPolicy)
    drift: TrackPolicy = field(default_factory=TrackPolicy)

    @property
    def of_tracks(self) -> tuple[TrackPolicy, ...]:
        """Policies of tracks, in their order; identities are decided before views are stored."""
        return self.drift, self.identity, self.visibility


def cut_off(boxes: F64, size_px: tuple[int, int] | None) -> BOOL:
    """Return the boxes (Nx4, xyxy, pixels) that reach the left or right image border."""
    if size_px is None:
        return np.zeros(len(boxes), np.bool_)
    edge = EDGE_RATIO * size_px[0]
    return np.asarray((boxes[:, 0] < edge) | (boxes[:, 2] > size_px[0] - edge))
