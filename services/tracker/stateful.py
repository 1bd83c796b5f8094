"""Checkpoints of trackers, and the base of those whose state is a set of tracks."""

from typing import Any, TypeVar

import msgspec
import numpy as np

from people4d.errors import DecodeError
from people4d.messages import F64, Track
from services.tracker.interface import GalleryEntry, IdCounter, Observation, Tracker
from services.tracker.motion.track_record import TrackRecord
from services.tracker.motion.track_set import TrackSet

T = TypeVar("T")


class TrackerCheckpoint(msgspec.Struct, frozen=True, kw_only=True):
    """The state of a tracker."""

    method: str  # name of the tracker
    next_id: int  # the next identity to be given
    stamp_ns: int | None  # [ns] of the last frame; None: there was none
    records: list[TrackRecord]
    embedder: tuple[str, int] = ("", 0)  # name and length of the embeddings
    gallery: list[tuple[int, GalleryEntry]] = []  # by identity, longest unseen first


class TrackSetTracker(Tracker):
    """A tracker whose state is a set of tracks."""

    ids: IdCounter

    def __init__(self, method: str, tracks: TrackSet) -> None:
        self._method = method
        self.tracks = tracks
        self.ids = tracks.ids

    def update_late(self, observation: Observation, now_ns: int) -> list[Track]:  # noqa: ARG002
        """Process a late frame at its own time, and then all that was matched since again."""
        self.tracks.go_back(observation.stamp_ns)
        try:
            return self.update(observation)
        finally:
            self.tracks.go_forward()

    def predict(self, stamp_ns: int) -> list[Track]:
        """Return the tracks predicted to a later time."""
        return self.tracks.predicted(stamp_ns)

    def reset(self) -> None:
        """Delete all tracks and times; identities go on counting."""
        self.tracks.clear()

    def postpone(self, duration_ns: int) -> None:
        """Skip a time without frames."""
        self.tracks.postpone(duration_ns)

    def checkpoint(self) -> TrackerCheckpoint:
        """Return the state."""
        return TrackerCheckpoint(
            method=self._method,
            next_id=self.ids.next,
            stamp_ns=self.tracks.stamp_ns,
            records=self.tracks.records,
        )

    def save(self) -> bytes:
        """Return a checkpoint of the state."""
        return pack(self.checkpoint())

    def restore(self, saved: bytes) -> None:
        """Continue from a checkpoint."""
        self.restore_checkpoint(unpack(saved, TrackerCheckpoint))

    def restore_checkpoint(self, state: TrackerCheckpoint) -> None:
        """Continue from a state.

        Raises:
            DecodeError: It is of another method, or inconsistent; nothing has changed then.
        """
        if state.method != self._method:
            raise DecodeError(f"checkpoint: expected method {self._method}, got {state.method}")
        embeddings = [t.embedding for t in state.records if t.embedding is not None]
        embeddings += [view for _, entry in state.gallery for view in entry.views]
        try:
            if any(e.shape != embeddings[0].shape or e.ndim != 1 for e in embeddings):
                raise ValueError("expected embeddings of one length")
            self.tracks.restore(state.records, state.stamp_ns)
        except ValueError as error:
            raise DecodeError(f"checkpoint: {error}") from error
        self.ids.raise_to(state.next_id)


def pack(record: msgspec.Struct) -> bytes:
    """Return a record as bytes."""
    return msgspec.msgpack.encode(record, enc_hook=_array_to_list)


def unpack(saved: bytes, kind: type[T]) -> T:
    """Return a record from bytes.

    Raises:
        DecodeError: They are no such record.
    """
    try:
        return msgspec.msgpack.decode(saved, type=kind, dec_hook=_list_to_array)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise DecodeError(f"checkpoint is no {kind.__name__}: {error}") from error


def _array_to_list(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if not isinstance(value, np.ndarray):
        raise NotImplementedError(f"cannot encode {type(value).__name__}")
    return [value.shape, np.ascontiguousarray(value, "<f8").tobytes()]


def _list_to_array(kind: Any, value: Any) -> F64:  # noqa: ARG001
    match value:
        case [[*shape], bytes() as data] if len(data) % 8 == 0:
            array = np.frombuffer(data, "<f8").astype(np.float64)
            if all(type(n) is int for n in shape) and np.all(np.isfinite(array)):
                return array.reshape(shape)  # a wrong shape raises ValueError: ValidationError
    raise ValueError("expected an array of finite numbers")
