"""Identity policy: re-identification of returning people (docs/method.md, section 15)."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from common.appearance import NEAREST_VIEWS, REIDENTIFICATION_MAX, TEMPERATURE, view_distance
from people4d.messages import F64
from services.tracker.interface import GalleryEntry, Observation
from services.tracker.motion.track_record import BOOL, IdentityDecision, TrackRecord
from services.tracker.motion.track_set import TrackSet
from services.tracker.sort3d.association import distances
from services.tracker.strongsort3d.config import IdentityConfig
from services.tracker.strongsort3d.gallery import Gallery
from services.tracker.strongsort3d.policies import (
    AssociationResult,
    FrameContext,
    IdentityPolicy,
)

ABSENT_NS = 1_000_000_000  # minimum time without frames that makes positions ambiguous [ns]
AMBIGUITY_RATIO = 0.5  # maximum ratio of the distances to the detection and to its rivals
YOUNG_NS = 2_000_000_000  # maximum age of a track whose identity may change [ns]
CHANGE_MIN = 0.9  # probability of another identity above which it replaces the published one


@dataclass(slots=True)
class CropEvidence:
    """Crops of a young track, compared with the gallery."""

    crops: int = 0  # number of crops
    distances: dict[int, float] = field(default_factory=dict)  # mean cosine distance by person
    before: list[F64] = field(default_factory=list)  # views of its person before the track


class Reidentification(IdentityPolicy):
    """Decides the identity of each new track, and again during its first two seconds."""

    recognises = True

    def __init__(self, config: IdentityConfig) -> None:
        self._gallery = Gallery(config.retention_s)
        self._evidence: dict[int, CropEvidence] = {}  # evidence of young tracks, by track

    def clear(self) -> None:
        """Drop all embeddings."""
        self._gallery.entries.clear()
        self._evidence.clear()

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
        self._evidence.pop(identity, None)
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
        """Decide identities of young tracks, and add all matches to the gallery."""
        frame = result.frame
        stamp_ns = frame.observation.stamp_ns
        self._gallery.drop_old(stamp_ns)
        young = {t.id for t in tracks.records if stamp_ns - t.begun_ns <= YOUNG_NS}
        self._evidence = {i: one for i, one in self._evidence.items() if i in young}
        for record, measurement in result.matches:
            if record.identity.identity is None:
                self._evidence.setdefault(record.id, CropEvidence())
            else:
                record.identity = replace(record.identity, identity="continued")
            if record.id in self._evidence:
                self._compare(tracks, record, measurement.embedding)
        confirmed = [match for match in result.matches if match[0].confirmed]
        for record, _ in confirmed:
            if record.id in self._evidence:
                self._decide(tracks, record, frame)
        for record, measurement in confirmed:
            self._gallery.add(record.id, record.x[:3], stamp_ns, measurement.embedding)

    def _compare(self, tracks: TrackSet, record: TrackRecord, embedding: F64 | None) -> None:
        """Add a crop to the mean distances between a young track and people absent since it began.

        Candidates are fixed at the first crop: later, more people could have walked there.
        """
        evidence, known = self._evidence[record.id], self._gallery.known()
        means = dict[int, float]()
        candidates = evidence.distances if evidence.crops else known
        evidence.crops += embedding is not None
        tracked = {t.id: t.detection is not None or _beside(t, record) for t in tracks.records}
        for identity in sorted(candidates.keys() & known.keys()):
            person, own = known[identity], identity == record.id
            if not own and tracked.get(identity, person.matched_ns >= record.begun_ns):
                continue
            views, mean = evidence.before if own else person.views, evidence.distances.get(identity)
            if embedding is not None and views:
                distance = view_distance(embedding, views, NEAREST_VIEWS)
                mean = distance if mean is None else mean + (distance - mean) / evidence.crops
            if mean is not None:
                means[identity] = mean
        evidence.distances = means

    def _decide(self, tracks: TrackSet, record: TrackRecord, frame: FrameContext) -> None:
        """Decide the identity of a young track; None is a new person."""
        evidence, is_first = self._evidence[record.id], record.identity.identity is None
        own, people = record.id if evidence.before else None, evidence.distances
        limit = REIDENTIFICATION_MAX.get(frame.observation.embedder, frame.cosine_distance_max)
        posterior = identity_posterior(people, limit)
        best = max(posterior, key=lambda i: posterior[i])
        if not is_first and (best == own or posterior[best] <= CHANGE_MIN):
            record.identity = replace(record.identity, confidence=posterior[own])
            return
        kind: Literal["new", "reidentified"] = "new" if best is None else "reidentified"
        record.identity = IdentityDecision(kind, posterior[best], reason_of(people, limit))
        if best is not None:
            tracks.end({best})  # the lost track of the same person
            self._rename(record, best)
        elif not is_first:
            self._rename(record, tracks.ids.new())

    def _rename(self, record: TrackRecord, identity: int) -> None:
        """Change the identity of a young track, whose crops leave the gallery."""
        evidence = self._evidence.pop(record.id)
        if (entry := self._gallery.entries.pop(record.id, None)) and evidence.before:
            entry.views = evidence.before
            self._gallery.entries[record.id] = entry
        person = self._gallery.known().get(identity)
        evidence.before = list(person.views) if person else []
        record.id, self._evidence[identity] = identity, evidence


def identity_posterior(distances: Mapping[int, float], limit: float) -> dict[int | None, float]:
    """Return the probability of each person, and of a new one (None).

    The log-odds of a person against a new one are (limit - distance) / TEMPERATURE.
    """
    log_odds = {None: 0.0} | {i: (limit - d) / TEMPERATURE for i, d in distances.items()}
    weights = np.exp(np.array(list(log_odds.values())) - max(log_odds.values()))
    return dict(zip(log_odds, (weights / weights.sum()).tolist(), strict=True))


def reason_of(distances: Mapping[int, float], limit: float) -> str:
    """Return the reason of a decision: the two least distances."""
    if not distances:
        return "no known person is absent"
    nearest = sorted(distances, key=lambda i: (distances[i], i))[:2]
    reason = ", ".join(f"{distances[i]:.2f} to {i}" for i in nearest)
    above = f": above {limit:.2f}" if distances[nearest[0]] > limit else ""
    return f"cosine distance {reason}{above}"


def _beside(record: TrackRecord, new: TrackRecord) -> bool:
    """Return True if one camera detected both tracks in the same frame: they are two people."""
    return record.camera == new.camera and record.matched_ns >= new.begun_ns


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
