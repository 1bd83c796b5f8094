"""Types of ROS 2 messages: definitions, CDR, and hashes of REP 2016."""

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from people4d.codec import MAX_BYTES
from people4d.errors import ConfigError, DecodeError

Fields: TypeAlias = Mapping[str, Any]

# Definitions of the used types have not changed since Humble.
RELEASE = Stores.ROS2_JAZZY

ZEROS: Mapping[str, Any] = {"string": "", "bool": False}
BYTES = {"char": "uint8", "byte": "uint8", "octet": "uint8"}  # numpy's names of types
DEFAULTS: Mapping[str, Fields] = {"geometry_msgs/msg/Quaternion": {"w": 1.0}}  # identity rotation


@cache
def definitions() -> dict[str, str]:
    """Return the texts of types that are not part of ROS 2, by name."""
    files = Path(__file__).with_name("definitions").glob("*/*.msg")
    return {f"{file.parent.name}/msg/{file.stem}": file.read_text("utf-8") for file in files}


@cache
def typestore() -> Typestore:
    """Return the types of ROS 2 and of `definitions`."""
    store = get_typestore(RELEASE)
    for name, text in definitions().items():
        store.register(get_types_from_msg(text, name))
    return store


def encode(kind: str, fields: Fields) -> bytes:
    """Return a message in CDR; omitted fields are 0, empty or false.

    Args:
        kind: Type, for example "people_msgs/msg/People".
        fields: Fields by name; inner messages are mappings.
    """
    return bytes(typestore().serialize_cdr(make(kind, fields), kind))


def decode(kind: str, cdr: bytes) -> Any:
    """Return a message from untrusted bytes; DecodeError for other payloads."""
    if len(cdr) > MAX_BYTES:
        raise DecodeError(f"{kind}: expected at most {MAX_BYTES} bytes, got {len(cdr)}")
    try:
        return typestore().deserialize_cdr(cdr, kind)
    except Exception as error:  # damaged bytes make rosbags raise almost anything
        reason = f"{type(error).__name__} {error}"[:80].strip()
        raise DecodeError(f"expected {kind} in CDR, got {reason}") from error


@cache
def type_hash(kind: str) -> str:
    """Return the hash of a type, "RIHS01_" and 64 digits, or raise ConfigError."""
    if kind not in typestore().fielddefs:
        raise ConfigError(f"type {kind!r} of ROS is unknown")
    return typestore().hash_rihs01(kind)


def dds_name(kind: str) -> str:
    """Return the name of a type on DDS, and in keys of rmw_zenoh."""
    package, middle, name = kind.split("/")
    return f"{package}::{middle}::dds_::{name}_"


def make(kind: str, fields: Fields) -> Any:
    """Return an immutable message of rosbags; omitted fields are 0, empty or false.

    KeyError if the type or a field is unknown.
    """
    return _maker(kind)(fields)


@cache
def _maker(kind: str) -> Callable[[Fields], Any]:
    """Return the function that makes messages of a type."""
    store = typestore()
    described: Any = store.fielddefs[kind][1]
    constructor: Any = store.types[kind]
    converters = {name: _converter(node, detail) for name, (node, detail) in described}
    defaults = {name: _default(node, detail) for name, (node, detail) in described}

    def maker(fields: Fields) -> Any:
        values = defaults.copy()
        for name, value in fields.items():
            convert = converters[name]
            values[name] = convert(value) if convert else value
        return constructor(**values)

    return maker


def _default(node: Nodetype, detail: Any) -> Any:
    """Return the value of an omitted field, shared by messages."""
    if node is Nodetype.NAME:
        return make(detail, DEFAULTS.get(detail, {}))
    if node is Nodetype.BASE:
        return ZEROS.get(detail[0], 0)
    (inner, inner_detail), size = detail
    count = size if node is Nodetype.ARRAY else 0
    if inner is Nodetype.BASE and inner_detail[0] not in ZEROS:
        return np.zeros(count, BYTES.get(inner_detail[0], inner_detail[0]))
    return [_default(inner, inner_detail)] * count


def _converter(node: Nodetype, detail: Any) -> Callable[[Any], Any] | None:
    """Return the function that converts a given value of a field; None if none is needed."""
    if node is Nodetype.NAME:
        return _maker(detail)
    if node is Nodetype.BASE:
        return None
    (inner, inner_detail), _ = detail
    if inner is Nodetype.NAME:
        maker = _maker(inner_detail)
        return lambda items: [maker(item) for item in items]
    if inner_detail[0] in ZEROS:
        return list
    kind = BYTES.get(inner_detail[0], inner_detail[0])

    def numbers(values: Any) -> Any:
        with np.errstate(over="ignore"):  # float64 may overflow float32
            return np.asarray(values, kind).ravel()

    return numbers
