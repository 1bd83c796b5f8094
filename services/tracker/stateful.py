"""Checkpoints of trackers, and a base class for trackers whose state is a set of tracks."""

import msgspec

from common.io.packed import pack, unpack
from people4d.messages import Track
from services.tracker.interface import GalleryEntry, IdCounter, Tracker
from services.tracker.motion.track_record import TrackRecord
from services.tracker.motion.track_set import TrackSet


class TrackerCheckpoint(msgspec.Struct, frozen=True, kw_only=True):
    """The state of a tracker."""

    next_id: int  # next unused identity
    stamp_ns: int | None  # [ns] stamp of the last frame; None before the first
    records: list[TrackRecord]
    embedder: tuple[str, int] = ("", 0)  # name and length of the embeddings
    gallery: list[tuple[int, GalleryEntry]] = []  # people by identity, longest unseen first


class TrackSetTracker(Tracker):
    """A tracker whose state is a set of tracks."""

    ids: IdCounter

    def __init__(self, tracks: TrackSet) -> None:
        self.tracks = tracks
        self.ids = tracks.ids

    def predict(self, stamp_ns: int) -> list[Track]:
        """Return the tracks predicted to a later time."""
        return self.tracks.predicted(stamp_ns)

    def reset(self) -> None:
        """Delete all tracks and times; identities are not reused."""
        self.tracks.clear()

    def checkpoint(self) -> TrackerCheckpoint:
        """Return the state."""
        return TrackerCheckpoint(
            next_id=self.ids.next, stamp_ns=self.tracks.stamp_ns, records=self.tracks.records
        )

    def save(self) -> bytes:
        """Return a checkpoint of the state."""
        return pack(self.checkpoint())

    def restore(self, saved: bytes) -> None:
        """Continue from a checkpoint."""
        self.restore_checkpoint(unpack(saved, TrackerCheckpoint))

    def restore_checkpoint(self, state: TrackerCheckpoint) -> None:
        """Continue from a state."""
        self.tracks.restore(state.records, state.stamp_ns)
        self.ids.raise_to(state.next_id)
