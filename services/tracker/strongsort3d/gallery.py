"""Gallery of people: their embeddings, for re-identification when they return."""

from collections.abc import Mapping

from common.appearance import add_view
from people4d.messages import F64
from services.tracker.interface import GalleryEntry

PEOPLE_MAX = 100  # maximum number of people; the longest unseen one is deleted first


class Gallery:
    """Appearance gallery of a tracker: at most PEOPLE_MAX people with VIEWS_MAX views each."""

    def __init__(self, retention_s: float) -> None:
        self._retention_s = retention_s  # [s] time in the gallery since the last match
        self.entries: dict[int, GalleryEntry] = {}  # people by identity, longest unseen first
        self.neighbours: Mapping[int, GalleryEntry] = {}  # people of other areas, by identity

    def add(self, identity: int, position_m: F64, stamp_ns: int, embedding: F64 | None) -> None:
        """Record a match of a person, and its embedding unless it is similar to a stored view."""
        entry = self.entries.pop(identity, None) or GalleryEntry(position_m, stamp_ns)
        entry.position_m, entry.matched_ns = position_m.copy(), stamp_ns
        entry.matches += 1
        if entry.matches == 1 and identity in self.neighbours:
            entry.views = list(self.neighbours[identity].views)
        self.entries[identity] = entry  # the longest unseen person is first
        if len(self.entries) > PEOPLE_MAX:
            del self.entries[next(iter(self.entries))]
        if embedding is not None:
            add_view(entry.views, embedding)

    def drop_old(self, stamp_ns: int) -> None:
        """Delete people whose last match is too old."""
        oldest_ns = stamp_ns - self._retention_s * 1e9
        while self.entries:
            identity = next(iter(self.entries))
            if self.entries[identity].matched_ns >= oldest_ns:
                return
            del self.entries[identity]

    def known(self) -> dict[int, GalleryEntry]:
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
