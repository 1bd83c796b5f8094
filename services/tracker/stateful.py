"""Checkpoints of trackers, and a base class for trackers whose state is a set of tracks."""

from typing import Any, TypeVar

import msgspec
import numpy as np

from people4d.errors import DecodeError
from people4d.messages import F64, Track
from services.tracker.interface import GalleryEntry, IdCounter, Tracker
from services.tracker.motion.track_record import TrackRecord
from services.tracker.motion.track_set import TrackSet

T = TypeVar("T")


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


def pack(record: msgspec.Struct) -> bytes:
    """Return a record as bytes."""
    return msgspec.msgpack.encode(record, enc_hook=_array_to_list)


def unpack(saved: bytes, kind: type[T]) -> T:
    """Return a record from bytes; DecodeError if they are invalid."""
    try:
        return msgspec.msgpack.decode(saved, type=kind, dec_hook=_list_to_array)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DecodeError(f"checkpoint is no {kind.__name__}: {error}") from error


def _array_to_list(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    return [value.shape, np.ascontiguousarray(value, "<f8").tobytes()]


def _list_to_array(kind: Any, value: Any) -> F64:  # noqa: ARG001
    shape, data = value
    return np.frombuffer(data, "<f8").astype(np.float64).reshape(shape)
