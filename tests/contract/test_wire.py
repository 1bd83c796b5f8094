"""The format in docs/development/messages.md, decoded without our codec."""

from collections.abc import Callable
from typing import Any

import msgpack
import msgspec
import numpy as np
import pytest

from people4d.codec import MESSAGES, encode
from people4d.messages import Message
from people4d.topics import TOPICS
from tests import ROOT
from tests.contract.examples import BY_NAME, FULL, SPARSE, TRACK
from tests.docs.pages import blocks

DOCS = ROOT / "docs" / "development" / "messages.md"
PARAMETERS = [pytest.param(m, id=type(m).__name__) for m in (*FULL, *SPARSE)]


@pytest.fixture(scope="module")
def documented_decode() -> Callable[[bytes], dict[str, Any]]:
    """Decoder of the documentation, its first Python block."""
    block, *_ = (b for b in blocks("python") if b.page == DOCS)
    names: dict[str, Any] = {}
    exec(block.code, names)
    decode: Callable[[bytes], dict[str, Any]] = names["decode"]
    return decode


def assert_same(wire: Any, value: Any) -> None:
    """Compare what the wire holds with a message, field by field."""
    if isinstance(value, msgspec.Struct):
        assert set(wire) - {"message", "version"} == set(value.__struct_fields__)
        for name in value.__struct_fields__:
            assert_same(wire[name], getattr(value, name))
    elif isinstance(value, np.ndarray):
        assert isinstance(wire, np.ndarray)
        assert wire.dtype == value.dtype
        np.testing.assert_array_equal(wire, value)
    elif isinstance(value, tuple):
        assert len(wire) == len(value)
        for below, item in zip(wire, value, strict=True):
            assert_same(below, item)
    else:
        assert wire == value
        assert type(wire) is type(value)


def test_there_is_an_example_of_every_message() -> None:
    assert BY_NAME.keys() == MESSAGES.keys() == {topic.message.__name__ for topic in TOPICS}


@pytest.mark.parametrize("message", PARAMETERS)
def test_the_documented_example_reads_every_field(
    message: Message, documented_decode: Callable[[bytes], dict[str, Any]]
) -> None:
    wire = documented_decode(encode(message))
    assert (wire["message"], wire["version"]) == (type(message).__name__, message.VERSION)
    assert_same(wire, message)


def test_an_array_is_little_endian_and_row_major(
    documented_decode: Callable[[bytes], dict[str, Any]],
) -> None:
    # A Fortran-ordered, big-endian covariance must be decoded to the same numbers.
    odd = np.asfortranarray(TRACK.covariance.astype(">f8"))
    tracks = (msgspec.structs.replace(TRACK, covariance=odd),)
    message = msgspec.structs.replace(BY_NAME["Tracks"], tracks=tracks)
    wire = documented_decode(encode(message))
    np.testing.assert_array_equal(wire["tracks"][0]["covariance"], np.arange(36.0).reshape(6, 6))


def test_encoded_bytes_match_hand_worked_values() -> None:
    # Depth 256 mm is 00 01 little-endian, 65535 is ff ff; 2x3 pixels row by row.
    payload = encode(BY_NAME["RgbdFrame"])
    assert b"\x00\x00\x01\x00\x00\x01\xe8\x03\x88\x13\xff\xff" in payload
    assert b"\xa5shape\x92\x02\x03" in payload
    assert b"\xa5dtype\xa6uint16" in payload
    assert payload[1:].startswith(b"\xa7message\xa9RgbdFrame\xa7version\x01")


@pytest.mark.parametrize("message", FULL, ids=lambda message: type(message).__name__)
def test_documented_decode_refuses_another_version(
    message: Message, documented_decode: Callable[[bytes], dict[str, Any]]
) -> None:
    fields = msgpack.unpackb(encode(message)) | {"version": message.VERSION + 1}
    with pytest.raises(ValueError, match=f"expected version {message.VERSION}"):
        documented_decode(msgpack.packb(fields))
