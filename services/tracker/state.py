"""What a tracker knows as bytes, from which the next process goes on."""

from typing import Any, TypeVar

import msgspec
import numpy as np

from people4d.errors import DecodeError
from people4d.messages import F64
from services.tracker.identity.gallery import Gallery, Identity
from services.tracker.motion.population import Population, Target

T = TypeVar("T")


class People(msgspec.Struct, frozen=True, kw_only=True):
    """All people followed, and what recognises them."""

    method: str  # name of the tracker
    next_id: int  # the next identity to be given
    stamp_ns: int | None  # [ns] of the last frame; None: there was none
    targets: list[Target]
    embedder: tuple[str, int] = ("", 0)  # name and length of the embeddings
    gallery: list[tuple[int, Identity]] = []  # identity and looks, whom nobody saw longest first


class Memory(msgspec.Struct, frozen=True, kw_only=True):
    """All that the service knows."""

    frame_id: str  # frame that tracks are in
    stamp_ns: int  # [ns] of the last frame tracked
    transforms: dict[str, F64]  # 4x4 by optical frame: where the cameras stand
    people: bytes  # of the tracker, in its own format


def save(
    method: str,
    people: Population,
    embedder: tuple[str, int] = ("", 0),
    gallery: Gallery | None = None,
) -> bytes:
    """Return what a tracker knows.

    Args:
        method: Name of the tracker.
        people: Whom it follows.
        embedder: Name and length of the embeddings.
        gallery: Who was here before; None: nobody is remembered.
    """
    saved = People(
        method=method,
        next_id=people.identities.next,
        stamp_ns=people.stamp_ns,
        targets=people.targets,
        embedder=embedder,
        gallery=list(gallery.people.items()) if gallery else [],
    )
    return pack(saved)


def restore(
    method: str, people: Population, saved: bytes, gallery: Gallery | None = None
) -> tuple[str, int]:
    """Go on with what `save` returned.

    Args:
        method: Name of the tracker.
        people: Nobody yet.
        saved: From `save`.
        gallery: To be filled; None: nobody is remembered.

    Returns:
        Name and length of the embeddings.

    Raises:
        DecodeError: It is of another method, or damaged; nothing has changed then.
    """
    known = unpack(saved, People)
    if known.method != method:
        raise DecodeError(f"what the tracker kept: expected people of {method}, got {known.method}")
    looks = [t.embedding for t in known.targets if t.embedding is not None]
    looks += [view for _, identity in known.gallery for view in identity.views]
    try:
        if any(look.shape != looks[0].shape or look.ndim != 1 for look in looks):
            raise ValueError("expected embeddings of one length")
        people.restore(known.targets, known.stamp_ns)
    except ValueError as error:
        raise DecodeError(f"what the tracker kept: {error}") from error
    people.identities.raise_to(known.next_id)
    if gallery:
        gallery.people = dict(known.gallery)
    return known.embedder


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
    except (msgspec.DecodeError, RecursionError) as error:
        raise DecodeError(f"what the tracker kept is no {kind.__name__}: {error}") from error


def _array_to_list(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if not isinstance(value, np.ndarray):
        raise NotImplementedError(f"cannot keep {type(value).__name__}")
    return [value.shape, np.ascontiguousarray(value, "<f8").tobytes()]


def _list_to_array(kind: Any, value: Any) -> F64:  # noqa: ARG001
    match value:
        case [[*shape], bytes() as data] if len(data) % 8 == 0:
            array = np.frombuffer(data, "<f8").astype(np.float64)
            if all(type(n) is int for n in shape) and np.all(np.isfinite(array)):
                return array.reshape(shape)  # a wrong shape raises ValueError, which msgspec tells
    raise ValueError("expected an array of finite numbers")
