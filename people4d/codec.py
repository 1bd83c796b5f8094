"""Messages to and from MessagePack.

On the wire a message is one map: `message` (type), `version`, then its fields by name. An array
is a map of `dtype` (numpy name, little-endian), `shape` and `data` (row-major bytes).
"""

import contextlib
import itertools
import threading
from collections.abc import Callable
from functools import cache
from typing import Any, get_args

import msgpack
import msgspec
import numpy as np
import numpy.typing as npt

from people4d.errors import DecodeError
from people4d.messages import Detections, Message, Span
from people4d.topics import TOPICS
from people4d.validation import describe, explain

MAX_BYTES = 64 * 2**20
MAX_ITEMS = 4096
MAX_TEXT = 65536  # maximum length of a text [bytes]
MAX_CONTAINERS = 65536
MAX_AXES = 4
ARRAY_KEYS = {"dtype", "shape", "data"}
VELOCITIES = ("velocity_mps", "velocity_covariance_m2ps2")  # removed fields of a detection

MESSAGES: dict[str, type[Message]] = {topic.message.__name__: topic.message for topic in TOPICS}
_prepared = threading.Event()  # set once msgspec has examined every type
_preparing = threading.Lock()


def encode(message: Message, publishing: Callable[[], Span] | None = None) -> bytes:
    """Encode a message as MessagePack.

    Args:
        message: Message to encode.
        publishing: Returns the last stage of its trace; called after all other fields are encoded.
    """
    fields = msgspec.to_builtins(message, enc_hook=_array_to_map, builtin_types=(bytes, memoryview))
    trace = fields.pop("trace")
    header = {"message": type(message).__name__, "version": message.VERSION}
    packer = msgpack.Packer(autoreset=False)
    packer.pack_map_header(len(header) + len(fields) + 1)
    for name, value in (header | fields).items():
        packer.pack(name)
        packer.pack(value)
    if publishing:
        trace = (*trace, msgspec.to_builtins(publishing()))
    packer.pack("trace")
    packer.pack(trace)
    packed: bytes = packer.bytes()
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
    fields = _unpack(payload)
    name, version = fields.pop("message", None), fields.pop("version", None)
    kind = MESSAGES.get(name) if isinstance(name, str) else None
    if kind is None:
        raise DecodeError(f"message: expected one of {', '.join(MESSAGES)}, got {describe(name)}")
    if type(version) is not int or version != kind.VERSION:
        raise DecodeError(
            f"{name}: expected version {kind.VERSION}, got {describe(version)}",
            "Run the same people4d release on all machines.",
        )
    if kind is Detections:
        _drop_velocities(fields)
    if not _prepared.is_set():
        _prepare()
    try:
        return msgspec.convert(fields, kind, dec_hook=_map_to_array)
    except (msgspec.ValidationError, RecursionError) as error:
        raise DecodeError(explain(error, fields, kind.__name__)) from error


def _prepare() -> None:
    """Make msgspec examine all types in one thread: two threads crash the process."""
    with _preparing:
        for kind in MESSAGES.values():
            with contextlib.suppress(msgspec.ValidationError):
                msgspec.convert({}, kind, dec_hook=_map_to_array)
        _prepared.set()


def _unpack(payload: bytes) -> dict[str, Any]:
    limit = _limit()
    try:
        fields = msgpack.unpackb(
            payload,
            max_str_len=MAX_TEXT,
            max_array_len=MAX_ITEMS,
            max_map_len=MAX_ITEMS,
            max_ext_len=0,
            object_hook=limit,
            list_hook=limit,
        )
    except (ValueError, msgpack.UnpackException) as error:
        reason = (str(error) or type(error).__name__)[:120]
        raise DecodeError(f"message: expected MessagePack, got {reason}") from error
    if not isinstance(fields, dict):
        raise DecodeError(f"message: expected a map, got {type(fields).__name__}")
    return fields


def _drop_velocities(fields: dict[str, Any]) -> None:
    """Drop velocities of detections, which older recordings have."""
    fields.pop("velocity_interval_s", None)
    people = fields.get("detections")
    for person in people if isinstance(people, list) else ():
        if isinstance(person, dict):
            for name in VELOCITIES:
                person.pop(name, None)


def _limit() -> Callable[[Any], Any]:
    """Return a hook that limits the number of containers in a payload."""
    count = itertools.count(1)

    def hook(container: Any) -> Any:
        if next(count) > MAX_CONTAINERS:
            raise ValueError(f"more than {MAX_CONTAINERS} lists and maps")
        return container

    return hook


def _array_to_map(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if not isinstance(value, np.ndarray):
        raise NotImplementedError(f"cannot encode {type(value).__name__}")
    name, on_wire = _wire_type(value.dtype)
    array = np.ascontiguousarray(value, on_wire)
    # A memoryview cannot be cast while an axis has no length.
    data = array.data.cast("B") if array.size else b""
    return {"dtype": name, "shape": value.shape, "data": data}


@cache
def _wire_type(dtype: np.dtype[Any]) -> tuple[str, np.dtype[Any]]:
    """Return the name of a number type, and the type in little-endian byte order."""
    return dtype.name, dtype.newbyteorder("<")


@cache
def _annotated_type(kind: Any) -> tuple[str, np.dtype[Any]]:
    """Return name and wire type of an annotated array."""
    return _wire_type(np.dtype(get_args(get_args(kind)[1])[0]))


def _map_to_array(kind: Any, value: Any) -> npt.NDArray[Any]:
    name, on_wire = _annotated_type(kind)
    if not isinstance(value, dict) or value.keys() != ARRAY_KEYS:
        raise ValueError(f"expected an array (dtype, shape, data), got {type(value).__name__}")
    shape, data = value["shape"], value["data"]
    if value["dtype"] != name:
        raise ValueError(f"expected dtype {name}, got {describe(value['dtype'])}")
    if not isinstance(data, bytes):
        raise ValueError(f"expected bytes as data, got {type(data).__name__}")
    if not isinstance(shape, list) or len(shape) > MAX_AXES:
        raise ValueError(f"expected a shape of at most {MAX_AXES} axes, got {describe(shape)}")
    size = on_wire.itemsize
    for n in shape:
        if type(n) is not int or not 0 <= n <= MAX_BYTES:
            lengths = ", ".join(map(describe, shape))
            raise ValueError(f"expected a shape of lengths from 0 to {MAX_BYTES}, got {lengths}")
        size *= n
    if len(data) != size:
        raise ValueError(f"expected {size} bytes for shape {shape}, got {len(data)}")
    return np.ndarray(shape, on_wire, data)
