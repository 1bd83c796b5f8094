"""Identity policy: re-identification of returning people (docs/method.md, section 15)."""

from collections.abc import Mapping

import numpy as np

from common.appearance import TEMPERATURE
from people4d.messages import F64
from services.tracker.interface import GalleryEntry, Observation
from services.tracker.motion.track_record import BOOL, IdentityDecision, TrackRecord
from services.tracker.motion.track_set import TrackSet
from services.tracker.sort3d.association import distances, match_probabilities
from services.tracker.strongsort3d.config import IdentityConfig
from services.tracker.strongsort3d.gallery import Gallery
from services.tracker.strongsort3d.policies import (
    AssociationResult,
    FrameContext,
    IdentityPolicy,
    Match,
)

ABSENT_NS = 1_000_000_000  # minimum time without frames that makes positions ambiguous [ns]
AMBIGUITY_RATIO = 0.5  # maximum ratio of the distances to the detection and to its rivals
DISTANCE_PROBABILITY = 0.5  # probability of a match in round 2, by distance alone


class Reidentification(IdentityPolicy):
    """Decides the identity of each new track by the crop of its confirming match."""

    recognises = True

    def __init__(self, config: IdentityConfig) -> None:
        self._config = config
        self._gallery = Gallery(config.retention_s)

    def clear(self) -> None:
        """Drop all embeddings."""
        self._gallery.entries.clear()

    def entries(self) -> list[tuple[int, GalleryEntry]]:
        """Return the gallery for a checkpoint."""
        return list(self._gallery.entries.items())

    def restore(self, entries: list[tuple[int, GalleryEntry]]) -> None:
        """Continue with the gallery of a checkpoint."""
        self._gallery.entries = dict(entries)

    def learn_neighbours(self, people: Mapping[int, GalleryEntry]) -> None:
        """Replace the people of neighbouring areas, by identity."""
        self._gallery.neighbours = people

    def rename(self, identity: int, to: int | None) -> None:
        """Change the identity of a person in the gallery; None: delete the person."""
        entry = self._gallery.entries.pop(identity, None)
        if entry and to is not None:
            self._gallery.entries.pop(to, None)
            self._gallery.entries[to] = entry

    def after_prediction(self, tracks: TrackSet, observation: Observation) -> None:
        """End ambiguous tracks after a time without frames.

        The other tracks count one more missed frame, so round 2 cannot match them by distance
        alone.
        """
        if tracks.elapsed_ns < ABSENT_NS:
            return
        for record in tracks.records:
            record.missed += 1
        records, measurements = tracks.confirmed, observation.measurements
        if not (records and measurements):
            return
        found_m = np.array([m.position_m for m in measurements])
        ambiguous = _ambiguous(tracks.positions_m(records), found_m)
        ended = {
            record.id
            for record, is_ambiguous in zip(records, ambiguous, strict=True)
            if is_ambiguous and record.embedding is not None
        }
        tracks.end(ended)

    def after_update(self, tracks: TrackSet, result: AssociationResult) -> None:
        """Decide identities of new tracks, and add all matches to the gallery."""
        frame, probabilities = result.frame, _probabilities(result)
        self._gallery.drop_old(frame.observation.stamp_ns)
        for match in result.matches:
            record, measurement = match
            if record.identity.identity is not None:
                pair, reason = (record.id, measurement.index), record.identity.reason
                probability = probabilities.get(pair, DISTANCE_PROBABILITY)
                record.identity = IdentityDecision("continued", probability, reason)
                self._add(match, frame)
        for match in result.matches:
            if match[0].confirmed and match[0].identity.identity is None:
                self._decide(tracks, match, frame)

    def _decide(self, tracks: TrackSet, match: Match, frame: FrameContext) -> None:
        """Decide the identity of a new track."""
        record, measurement = match
        present = {t.id for t in tracks.records if t.detection is not None or _beside(t, record)}
        limit = self._config.limit(frame.observation.embedder, frame.cosine_distance_max)
        candidates = self._gallery.absent(present)
        decision = self._gallery.decide(measurement.embedding, candidates, limit)
        record.identity = decision
        if decision.id is not None:
            # The lost track of the same person ends.
            tracks.end({decision.id})
            record.id = decision.id
        self._add(match, frame)

    def _add(self, match: Match, frame: FrameContext) -> None:
        record, measurement = match
        stamp_ns, occluded = frame.observation.stamp_ns, measurement.index in frame.cut_off
        self._gallery.add(record.id, record.x[:3], stamp_ns, measurement.embedding, occluded)


def _probabilities(result: AssociationResult) -> dict[tuple[int, int], float]:
    """Return the probabilities of matches in round 1, by track and detection."""
    first = result.by_appearance
    if not first.cost.size:
        return {}
    table = match_probabilities(first.cost, TEMPERATURE)
    rows = {record.id: i for i, record in enumerate(first.tracks)}
    columns = {m.index: j for j, m in enumerate(first.detections)}
    return {
        (record.id, m.index): float(table[rows[record.id], columns[m.index]])
        for record, m in first.matches
    }


def _beside(record: TrackRecord, new: TrackRecord) -> bool:
    """Return True if one camera detected both tracks in the same frame: they are two people."""
    return record.camera == new.camera and record.matched_ns >= new.begun_ns > 0


def _ambiguous(tracks_m: F64, found_m: F64) -> BOOL:
    """Return the tracks (N of Nx3) whose nearest detection (Mx3) has a similarly near rival.

    Rivals are other detections, and other tracks near the same detection.
    """
    distances_m = distances(tracks_m, found_m)
    rows, nearest = np.arange(len(tracks_m)), distances_m.argmin(axis=1)
    own_m = distances_m[rows, nearest]
    to_others_m = distances_m[:, nearest]
    np.fill_diagonal(to_others_m, np.inf)
    distances_m[rows, nearest] = np.inf
    rival_m = np.minimum(distances_m.min(axis=1), to_others_m.min(axis=0))
    return np.asarray(own_m > AMBIGUITY_RATIO * rival_m)
