"""Contact policy: association of people who touch or cross."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from people4d.messages import F64
from services.tracker.config import ContactConfig, StrongSort3dConfig
from services.tracker.interface import Measurement, Observation
from services.tracker.motion.track_record import BOOL, TrackRecord
from services.tracker.sort3d import association
from services.tracker.strongsort3d.occlusion import emergence_m
from services.tracker.strongsort3d.policies import (
    CandidatePairs,
    ContactPolicy,
    FrameContext,
    Match,
)
from services.tracker.strongsort3d.visibility import covered_ratios


class Contact(ContactPolicy):
    """Weigh position against appearance by how many people a crop shows, and limit speeds."""

    def __init__(self, config: StrongSort3dConfig) -> None:
        self._config, self._occlusion = config.contact, config.occlusion

    def prepare(self, observation: Observation, detections: list[Measurement]) -> list[Measurement]:
        """Add covariance along the ray to detections that others cover, see `depth_uncertain`."""
        return depth_uncertain(detections, observation, self._config)

    def miss_cost(self, frame: FrameContext) -> float:
        """Return C_cos: leave a track unmatched rather than break up a good pair."""
        return frame.cosine_distance_max

    def appearance(self, d_cos: F64, pairs: CandidatePairs) -> F64:
        """Let position decide among similar tracks and for crops that show several people."""
        config, records = self._config, pairs.records
        limit = config.ambiguous_factor * pairs.frame.cosine_distance_max
        d_cos = pool_ambiguous(d_cos, association.cosine_distances(records, records), limit)
        d_cos[:, ~pairs.unoccluded()] /= config.occluded_factor
        d_cos[:, ~pairs.separate()] /= config.overlapping_factor
        return d_cos

    def unreachable(self, pairs: CandidatePairs) -> BOOL:
        """Return the pairs (NxM) that no walking person explains."""
        stamp_ns, records = pairs.frame.observation.stamp_ns, pairs.records
        missed_s = np.array([stamp_ns - t.matched_ns for t in records]) / 1e9
        far = beyond_walking(pairs.tracks_m, missed_s, pairs.detections, self._config)
        return far | self._unreachable_hidden(pairs)

    def mismatch(self, d_cos: F64, pairs: CandidatePairs) -> BOOL:
        """Return the pairs (NxM) of a confirmed track and an unoccluded crop that differ."""
        limit = self._config.round2_factor * pairs.frame.cosine_distance_max
        confirmed = np.array([t.confirmed for t in pairs.records], np.bool_)
        differ = np.nan_to_num(d_cos) > limit
        return np.asarray(differ & confirmed[:, None] & pairs.unoccluded())

    def updates_embedding(self, match: Match, frame: FrameContext) -> bool:
        """Check that the crop shows one person, or that the track has no embedding yet."""
        record, measurement = match
        return record.embedding is None or measurement.index not in frame.occluded

    def alpha(self, alpha: float, record: TrackRecord) -> float:
        """Return alpha, or less so that the first embeddings of a track weigh the same."""
        return min(alpha, 1.0 - 1.0 / record.hits)

    def _unreachable_hidden(self, pairs: CandidatePairs) -> BOOL:
        """Return the detections (NxM) that an occluded person could not reach without being seen.

        An occluded person comes out beside those in front, or is at the predicted position; from
        there they walk as far as they can since they were occluded last.
        """
        observation, records, config = pairs.frame.observation, pairs.records, self._config
        pose = observation.map_from_camera
        here = [t.occluded > 0 and t.camera == observation.camera for t in records]
        if pose is None or not any(here):
            return np.zeros((len(records), len(pairs.detections)), np.bool_)
        occluded_s = np.array([(observation.stamp_ns - t.occluded_ns) / 1e9 for t in records])
        found_m = np.array([m.position_m for m in pairs.detections])
        out_m = emergence_m(found_m, pose, self._occlusion)
        gap_m = np.minimum(out_m, association.distances(pairs.tracks_m[:, :2], found_m[:, :2]))
        far = gap_m > config.jump_m + config.speed_max_mps * occluded_s[:, None]
        return np.asarray(far & np.array(here)[:, None])


def depth_uncertain(
    detections: list[Measurement], observation: Observation, config: ContactConfig
) -> list[Measurement]:
    """Add covariance along the ray to detections that others cover.

    The depth of a half hidden person is often that of the person in front.
    """
    pose = observation.map_from_camera
    if pose is None or config.depth_sigma_m == 0 or len(detections) < 2:
        return detections
    ratios = covered_ratios(np.array([m.box_xyxy_px for m in detections], np.float64))
    after = []
    for measurement, ratio in zip(detections, ratios, strict=True):
        ray = measurement.position_m - pose[:3, 3]
        ray /= max(float(np.linalg.norm(ray)), 1e-6)
        added_m2 = config.depth_sigma_m**2 * np.outer(ray, ray)
        covered = ratio > config.depth_covered_max
        after.append(replace(measurement, added_covariance_m2=added_m2) if covered else measurement)
    return after


def beyond_walking(
    positions_m: F64, missed_s: F64, detections: Sequence[Measurement], config: ContactConfig
) -> BOOL:
    """Return the pairs (NxM) that are farther apart on the ground than a person walks.

    Detections of uncertain depth are left to the Mahalanobis distance.
    """
    measured_m = np.array([m.position_m for m in detections])
    gap_m = association.distances(positions_m[:, :2], measured_m[:, :2])
    reach_m = config.jump_m + config.speed_max_mps * missed_s
    certain = np.array([m.added_covariance_m2 is None for m in detections])
    return np.asarray((gap_m > reach_m[:, None]) & certain)


def pool_ambiguous(d_cos: F64, own: F64, limit: float) -> F64:
    """Return the cosine distances (NxM, NaN where unknown), equal for tracks of similar appearance.

    Appearance cannot separate tracks whose own distances (NxN) are within a limit, so that their
    positions have to.
    """
    similar = np.nan_to_num(own, nan=np.inf) <= limit
    np.fill_diagonal(similar, True)
    pooled = np.nan_to_num(d_cos, nan=np.inf)
    for row in np.flatnonzero(similar.sum(axis=1) > 1):
        pooled[row] = np.nanmin(d_cos[similar[row]], axis=0, initial=np.inf)
    return np.where(np.isnan(d_cos), d_cos, pooled)
