"""Records of a checkpoint as bytes, with arrays of numbers."""

from typing import Any, TypeVar

import msgspec
import numpy as np

from people4d.errors import DecodeError
from people4d.messages import F64

T = TypeVar("T")


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
