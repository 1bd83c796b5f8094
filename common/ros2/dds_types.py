"""Types of DDS from the definitions of ROS 2 messages, with samples in CDR."""

from functools import cache
from typing import Any

from cyclonedds.idl import make_idl_struct, types
from rosbags.interfaces import Nodetype

from common.ros2.types import dds_name, typestore
from people4d.errors import ConfigError

# Types in IDL, as translated by rosidl.
PRIMITIVES: dict[str, Any] = {
    "bool": bool,
    "byte": types.byte,
    "octet": types.byte,
    "char": types.uint8,
    "string": str,
    "int8": types.int8,
    "int16": types.int16,
    "int32": types.int32,
    "int64": types.int64,
    "uint8": types.uint8,
    "uint16": types.uint16,
    "uint32": types.uint32,
    "uint64": types.uint64,
    "float32": types.float32,
    "float64": types.float64,
}


class CdrSample:
    """One message in CDR, exchanged with Cyclone DDS without conversion.

    Attributes:
        cdr: The message with its header of 4 bytes.
        sample_info: Origin, set by Cyclone DDS on reception.
    """

    sample_info: Any

    def __init__(self, cdr: bytes) -> None:
        self.cdr = cdr

    def serialize(self, use_version_2: bool | None = None) -> bytes:  # noqa: ARG002
        """Return the sent bytes."""
        return self.cdr

    @classmethod
    def deserialize(cls, data: bytes) -> "CdrSample":
        """Wrap received bytes."""
        return cls(data)

    @classmethod
    def deserialize_key(cls, _: bytes) -> "CdrSample":
        """Wrap the end of a publisher, which has no bytes."""
        return cls(b"")


@cache
def cdr_type(kind: str) -> type[CdrSample]:
    """Return the class of samples of a type, for topics of Cyclone DDS; ConfigError if unknown.

    Cyclone DDS announces the structure of the type and checks payloads against it, as for classes
    of its IDL compiler, but does not convert them to objects.
    """
    return type(CdrSample.__name__, (CdrSample,), {"__idl__": _struct(kind).__idl__})


@cache
def _struct(kind: str) -> Any:
    fields = typestore().fielddefs
    if kind not in fields:
        raise ConfigError(f"type {kind!r} of ROS is unknown")
    members = {name: _member(node, detail) for name, (node, detail) in fields[kind][1]}
    return make_idl_struct(kind.rpartition("/")[2], dds_name(kind), members)


def _member(node: Nodetype, detail: Any) -> Any:
    if node is Nodetype.NAME:
        return _struct(str(detail))
    if node is Nodetype.BASE:
        name, bound = detail
        if name not in PRIMITIVES:
            raise ConfigError(f"fields of type {name} are not supported on DDS")
        return types.bounded_str[bound] if bound else PRIMITIVES[name]
    inner, size = detail
    element = _member(*inner)
    if node is Nodetype.ARRAY:
        return types.array[element, size]
    return types.sequence[element, size] if size else types.sequence[element]
