"""Messages to and from MessagePack.

On the wire a message is one map: `message` (type), `version`, then its fields by name. An array
is a map of `dtype` (numpy name, little-endian), `shape` and `data` (row-major bytes).
"""

from typing import Any, get_args

import msgpack
import msgspec
import numpy as np
import numpy.typing as npt

from common.errors import DecodeError
from common.messages import Message
from common.topics import TOPICS

MAX_BYTES = 64 * 2**20
MAX_ITEMS = 4096

MESSAGES: dict[str, type[Message]] = {topic.message.__name__: topic.message for topic in TOPICS}


def encode(message: Message) -> bytes:
    """Encode a message as MessagePack."""
    fields = msgspec.to_builtins(message, enc_hook=_array_to_map, builtin_types=(bytes, memoryview))
    header = {"message": type(message).__name__, "version": message.VERSION}
    packed: bytes = msgpack.packb(header | fields)
    return packed


def decode(payload: bytes) -> Message:
    """Decode a message and check every field.

    Args:
        payload: MessagePack bytes, untrusted.

    Raises:
        DecodeError: The bytes are not a valid message of a known type and version.
    """
    if len(payload) > MAX_BYTES:
        raise DecodeError(f"message: expected at most {MAX_BYTES} bytes, got {len(payload)}")
    try:
        fields = msgpack.unpackb(
            payload, max_array_len=MAX_ITEMS, max_map_len=MAX_ITEMS, max_ext_len=0
        )
    except (ValueError, msgpack.UnpackException) as error:
        raise DecodeError(f"message: expected MessagePack, got {_short(error)}") from error
    if not isinstance(fields, dict):
        raise DecodeError(f"message: expected a map, got {type(fields).__name__}")
    name = fields.get("message")
    kind = MESSAGES.get(name) if isinstance(name, str) else None
    if kind is None:
        raise DecodeError(f"message: expected one of {', '.join(MESSAGES)}, got {name!r:.80}")
    if fields.get("version") != kind.VERSION:
        raise DecodeError(
            f"{name}: expected version {kind.VERSION}, got {fields.get('version')!r:.80}",
            "Run the same people4d release on all machines.",
        )
    try:
        return msgspec.convert(fields, kind, dec_hook=_map_to_array)
    except (msgspec.ValidationError, RecursionError) as error:
        raise DecodeError(f"{name}: {error}") from error


def _array_to_map(value: Any) -> dict[str, Any]:
    if not isinstance(value, np.ndarray):
        raise NotImplementedError(f"cannot encode {type(value).__name__}")
    array = np.ascontiguousarray(value, value.dtype.newbyteorder("<"))
    # A memoryview cannot be cast while an axis has no length.
    data = array.data.cast("B") if array.size else b""
    return {"dtype": value.dtype.name, "shape": value.shape, "data": data}


def _map_to_array(kind: Any, value: Any) -> npt.NDArray[Any]:
    want = np.dtype(get_args(get_args(kind)[1])[0])
    if not isinstance(value, dict) or not {"dtype", "shape", "data"} <= value.keys():
        raise ValueError(f"expected an array (dtype, shape, data), got {type(value).__name__}")
    shape, data = value["shape"], value["data"]
    if value["dtype"] != want.name:
        raise ValueError(f"expected dtype {want.name}, got {value['dtype']!r:.40}")
    if not isinstance(shape, list) or not all(type(n) is int and n >= 0 for n in shape):
        raise ValueError(f"expected a shape of lengths >= 0, got {shape!r:.80}")
    if len(shape) > 4 or not isinstance(data, bytes):
        raise ValueError("expected at most 4 axes and bytes as data")
    size = want.itemsize
    for n in shape:
        size *= n
    if len(data) != size:
        raise ValueError(f"expected {size} bytes for shape {shape}, got {len(data)}")
    return np.frombuffer(data, want.newbyteorder("<")).reshape(shape)


def _short(error: Exception) -> str:
    return (str(error) or type(error).__name__)[:120]
