"""Identity policy: re-identification of people who return."""

from dataclasses import dataclass, field

import numpy as np

from people4d.messages import F64
from services.tracker.config import IdentityConfig
from services.tracker.identity.gallery import Gallery, GalleryEntry, IdentityQuery
from services.tracker.interface import Observation
from services.tracker.motion.track_record import IdentityDecision, TrackRecord
from services.tracker.motion.track_set import TrackSet
from services.tracker.sort3d.association import match_probabilities
from services.tracker.strongsort3d.policies import AssociationResult, IdentityPolicy, Match
from services.tracker.strongsort3d.visibility import cut_off

DISTANCE_PROBABILITY = 0.5  # of a match of round 2, which goes by the distance alone


@dataclass(frozen=True, slots=True)
class _MatchQuality:
    """Quality of one match for re-identification."""

    unoccluded: bool  # the crop shows them alone, with a score that is high enough
    probability: float  # of the match


@dataclass(slots=True)
class _PendingIdentity:
    """A track whose identity is undecided."""

    since_ns: int  # [ns] stamp of the second match
    unoccluded: list[F64] = field(default_factory=list)  # embeddings of unoccluded crops
    others: list[F64] = field(default_factory=list)  # embeddings of other crops


class Reidentification(IdentityPolicy):
    """Decide the identity of each new track before it is confirmed.

    A track that could be of an absent person stays tentative until enough of its crops are
    unoccluded, or until a timeout.
    """

    def __init__(self, config: IdentityConfig) -> None:
        self._config = config
        self._gallery = Gallery(config)
        self._pending: dict[int, _PendingIdentity] = {}

    def clear(self) -> None:
        """Drop all embeddings."""
        self._gallery.entries.clear()
        self._pending.clear()

    def entries(self) -> list[tuple[int, GalleryEntry]]:
        """Return the gallery for a checkpoint."""
        return list(self._gallery.entries.items())

    def restore(self, entries: list[tuple[int, GalleryEntry]]) -> None:
        """Continue with the gallery of a checkpoint."""
        self._gallery.entries = dict(entries)

    def is_absent(self, record: TrackRecord, observation: Observation) -> bool:
        """Check that a track with an embedding was missed for too long, in view and unoccluded."""
        if record.occluded or record.embedding is None:
            return False
        missed_s = (observation.stamp_ns - record.matched_ns - record.out_of_view_ns) / 1e9
        config = self._config
        return missed_s > (config.absent_cut_off_s if record.cut_off else config.absent_s)

    def after_update(self, tracks: TrackSet, result: AssociationResult) -> None:
        """Decide the identity of new tracks, and add the matched ones to the gallery."""
        stamp_ns = result.frame.observation.stamp_ns
        mark_cut_off(result)
        qualities = self._qualities(result)
        self._gallery.drop_old(stamp_ns)
        for match, quality in zip(result.matches, qualities, strict=True):
            decision = match[0].identity
            if decision.identity is not None:
                match[0].identity = IdentityDecision(
                    "continued", quality.probability, decision.reason
                )
                self._add(match, quality, stamp_ns)
        limit = self._config.match_max or result.frame.cosine_distance_max
        for match, quality in zip(result.matches, qualities, strict=True):
            if match[0].identity.identity is None:
                self._decide(tracks, match, quality, limit)
        ids = {record.id for record in tracks.records}
        self._pending = {id_: p for id_, p in self._pending.items() if id_ in ids}

    def _qualities(self, result: AssociationResult) -> list[_MatchQuality]:
        first, score_min = result.by_appearance, self._config.score_min
        probabilities = dict[tuple[int, int], float]()
        if first.cost.size:
            table = match_probabilities(first.cost, self._config.temperature)
            rows = {record.id: i for i, record in enumerate(first.tracks)}
            columns = {m.index: j for j, m in enumerate(first.detections)}
            probabilities = {
                (record.id, m.index): float(table[rows[record.id], columns[m.index]])
                for record, m in result.matches
                if record.id in rows
            }
        occluded = result.frame.occluded
        return [
            _MatchQuality(
                m.index not in occluded and m.score >= score_min,
                probabilities.get((record.id, m.index), DISTANCE_PROBABILITY),
            )
            for record, m in result.matches
        ]

    def _decide(self, tracks: TrackSet, match: Match, quality: _MatchQuality, limit: float) -> None:
        """Decide the identity of a new track, or keep it tentative."""
        (record, measurement), stamp_ns = match, match[0].matched_ns
        pending = self._pending.setdefault(record.id, _PendingIdentity(stamp_ns))
        if measurement.embedding is not None:
            embeddings = pending.unoccluded if quality.unoccluded else pending.others
            embeddings.append(measurement.embedding)
        if not record.confirmed:
            return
        query = IdentityQuery(record.x[:3], stamp_ns, pending.unoccluded or pending.others)
        present = {t.id for t in tracks.records if t.detection is not None}
        candidates = self._gallery.plausible(query, present)
        waits = stamp_ns - pending.since_ns < self._config.wait_s * 1e9
        if candidates and waits and len(pending.unoccluded) < self._config.embeddings_min:
            record.confirmed = False
            return
        del self._pending[record.id]
        record.identity = decision = self._gallery.decide(query, candidates, limit)
        if decision.id is not None:
            # The lost track of the same person ends here.
            tracks.records = [t for t in tracks.records if t.id != decision.id]
            record.id = decision.id
        self._add(match, quality, stamp_ns)

    def _add(self, match: Match, quality: _MatchQuality, stamp_ns: int) -> None:
        record, measurement = match
        embedding = measurement.embedding if quality.unoccluded else None
        self._gallery.add(record.id, record.x[:3], stamp_ns, embedding)


def mark_cut_off(result: AssociationResult) -> None:
    """Mark tracks whose box reaches the left or right of the image: if they vanish, they left."""
    boxes = np.array([m.box_xyxy_px for _, m in result.matches], np.float64).reshape(-1, 4)
    cut = cut_off(boxes, result.frame.observation.size_px)
    for (record, _), is_cut in zip(result.matches, cut, strict=True):
        record.cut_off = bool(is_cut)
