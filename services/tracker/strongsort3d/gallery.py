"""Gallery of people: their embeddings, for re-identification when they return."""

from collections.abc import Container, Mapping, Sequence

import numpy as np

from common.appearance import NEAREST_VIEWS, TEMPERATURE, add_view, view_distance
from people4d.messages import F64
from services.tracker.interface import GalleryEntry
from services.tracker.motion.track_record import IdentityDecision

PEOPLE_MAX = 100  # maximum number of people; the longest unseen one is deleted first


class Gallery:
    """Appearance gallery of a tracker: at most PEOPLE_MAX people with VIEWS_MAX views each."""

    def __init__(self, retention_s: float) -> None:
        self._retention_s = retention_s  # [s] time in the gallery since the last match
        self.entries: dict[int, GalleryEntry] = {}  # people by identity, longest unseen first
        self.neighbours: Mapping[int, GalleryEntry] = {}  # people of other areas, by identity

    def add(
        self,
        identity: int,
        position_m: F64,
        stamp_ns: int,
        embedding: F64 | None,
        occluded: bool = False,
    ) -> None:
        """Record a match of a person, and its embedding unless it is similar to a stored view.

        The view of an occluded crop is stored until a complete one replaces it.
        """
        entry = self.entries.pop(identity, None) or GalleryEntry(position_m, stamp_ns)
        entry.position_m, entry.matched_ns = position_m.copy(), stamp_ns
        entry.matches += 1
        if entry.matches == 1 and identity in self.neighbours:
            entry.views = list(self.neighbours[identity].views)
        self.entries[identity] = entry  # the longest unseen person is first
        if len(self.entries) > PEOPLE_MAX:
            del self.entries[next(iter(self.entries))]
        if embedding is None or (occluded and entry.views and not entry.occluded):
            return
        if entry.occluded:
            entry.views.clear()
        entry.occluded = occluded
        add_view(entry.views, embedding)

    def drop_old(self, stamp_ns: int) -> None:
        """Delete people whose last match is too old."""
        oldest_ns = stamp_ns - self._retention_s * 1e9
        while self.entries:
            identity = next(iter(self.entries))
            if self.entries[identity].matched_ns >= oldest_ns:
                return
            del self.entries[identity]

    def absent(self, present: Container[int]) -> list[int]:
        """Return the absent people with views."""
        return [i for i, entry in self._known().items() if i not in present and entry.views]

    def decide(
        self, embedding: F64 | None, candidates: Sequence[int], limit: float
    ) -> IdentityDecision:
        """Decide which candidate a new track with this embedding is, or that it is a new person.

        The distance of a candidate is the mean to its two nearest views. A new person is an option
        at the distance `limit`, the maximum distance of one person. An option at distance d has the
        weight exp(-d / TEMPERATURE); its share of the sum is the confidence.
        """
        if not candidates:
            return IdentityDecision("new", 1.0, "no known person is absent")
        if embedding is None:
            return IdentityDecision("new", 0.5, "no embedding")
        known = self._known()
        distances = [view_distance(embedding, known[k].views, NEAREST_VIEWS) for k in candidates]
        order = sorted(range(len(candidates)), key=lambda k: (distances[k], candidates[k]))
        best = order[0]
        weights = np.exp(-(np.array([*distances, limit]) - min(*distances, limit)) / TEMPERATURE)
        confidences = weights / weights.sum()
        reason = f"cosine distance {distances[best]:.2f} to {candidates[best]}"
        reason += f", {distances[order[1]]:.2f} to {candidates[order[1]]}" if len(order) > 1 else ""
        if distances[best] > limit:
            return IdentityDecision("new", float(confidences[-1]), f"{reason}: above {limit:.2f}")
        confidence = float(confidences[best])
        return IdentityDecision("reidentified", confidence, reason, candidates[best])

    def _known(self) -> dict[int, GalleryEntry]:
        """Return all people by identity, at their last positions, with all their views."""
        known = dict(self.entries)
        for identity, entry in self.neighbours.items():
            own = known.get(identity)
            if own is None:
                known[identity] = entry
            elif entry.matched_ns > own.matched_ns:
                views = [*own.views, *entry.views]
                known[identity] = GalleryEntry(entry.position_m, entry.matched_ns, views)
        return known
