"""Round trips of the codec, and nothing but DecodeError on any other input."""

import contextlib
import random
import re
import subprocess
import sys
import tracemalloc
from typing import Any

import msgpack
import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from people4d.codec import MAX_BYTES, MAX_CONTAINERS, decode, encode
from people4d.errors import DecodeError
from people4d.messages import Message
from tests.contract.examples import BY_NAME, FULL, SPARSE

PARAMETERS = [pytest.param(m, id=type(m).__name__) for m in (*FULL, *SPARSE)]
PAYLOADS = [encode(message) for message in (*FULL, *SPARSE)]
TRUTH = {"message": "Truth", "version": 1, "stamp_ns": 1, "sequence": 0, "frame_id": "map"}
ARRAY = {"dtype": "float64", "shape": [3], "data": bytes(24)}


def refusal(payload: bytes) -> str:
    with pytest.raises(DecodeError) as caught:
        decode(payload)
    return str(caught.value)


def truth_at(position: Any) -> bytes:
    packed: bytes = msgpack.packb(TRUTH | {"people": [{"id": "anna", "position_m": position}]})
    return packed


def fields_of(value: Any) -> Any:
    """Reduce a message to what == compares: arrays to dtype, shape and numbers."""
    if isinstance(value, msgspec.Struct):
        return [type(value), *(fields_of(getattr(value, n)) for n in value.__struct_fields__)]
    if isinstance(value, np.ndarray):
        return value.dtype.name, value.shape, value.tolist()
    return [fields_of(item) for item in value] if isinstance(value, tuple) else value


@pytest.mark.parametrize("message", PARAMETERS)
def test_a_message_survives_a_round_trip(message: Message) -> None:
    again = decode(encode(message))
    assert fields_of(again) == fields_of(message)
    assert encode(again) == encode(message)


@settings(deadline=None)
@given(st.binary(max_size=300))
def test_random_bytes_raise_nothing_but_decode_error(payload: bytes) -> None:
    refusal(payload)


@settings(max_examples=300, deadline=None)
@given(st.integers(0, len(PAYLOADS) - 1), st.integers(0, 2**32 - 1))
def test_mutated_payloads_raise_nothing_but_decode_error(which: int, seed: int) -> None:
    chance = random.Random(seed)
    payload = bytearray(PAYLOADS[which])
    for _ in range(chance.randint(1, 4)):
        payload[chance.randrange(len(payload))] = chance.randrange(256)
    with contextlib.suppress(DecodeError):
        decode(bytes(payload))


@pytest.mark.parametrize("message", PARAMETERS)
def test_truncated_payloads_are_refused(message: Message) -> None:
    payload = encode(message)
    for length in range(len(payload)):
        refusal(payload[:length])
    refusal(payload + b"\xc0")


TREES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=5)
    | st.binary(max_size=9),
    lambda below: (
        st.lists(below, max_size=4)
        | st.dictionaries(st.text(max_size=5), below, max_size=4)
        | st.fixed_dictionaries({"dtype": below, "shape": below, "data": below})
    ),
    max_leaves=8,
)


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(FULL), st.data())
def test_a_field_of_any_other_content_raises_nothing_but_decode_error(
    message: Message, data: st.DataObject
) -> None:
    fields = msgpack.unpackb(encode(message))
    fields[data.draw(st.sampled_from(sorted(fields)))] = data.draw(TREES)
    with contextlib.suppress(DecodeError):
        decode(msgpack.packb(fields))


REFUSED: list[tuple[bytes, str]] = [
    (b"", "message: expected MessagePack, got "),
    (msgpack.packb([1]), "message: expected a map, got list"),
    (msgpack.packb({}), "message: expected one of RgbdFrame, "),
    (msgpack.packb(TRUTH | {"message": "Person"}), "got 'Person'"),
    (msgpack.packb(TRUTH | {"message": ["Truth"]}), "got list"),
    (msgpack.packb(TRUTH | {"version": 2}), "Truth: expected version 1, got 2. Run the same"),
    (msgpack.packb(TRUTH | {"version": True}), "Truth: expected version 1, got True"),
    (msgpack.packb(TRUTH | {"sequence": "1"}), "Truth.sequence: expected `int`, got `str`"),
    (msgpack.packb(TRUTH | {"sequence": 1.5}), "Truth.sequence: expected `int`, got `float`"),
    (msgpack.packb(TRUTH | {"frame": "map"}), "Truth: object contains unknown field `frame`"),
    (
        msgpack.packb({k: v for k, v in TRUTH.items() if k != "frame_id"}),
        "Truth: object missing required field `frame_id`",
    ),
    (truth_at(3), "Truth.people[0].position_m: expected an array (dtype, shape, data), got int"),
    (truth_at(ARRAY | {"more": 1}), "expected an array (dtype, shape, data), got dict"),
    (truth_at(ARRAY | {"dtype": "float32"}), "expected dtype float64, got 'float32'"),
    (truth_at(ARRAY | {"dtype": "object"}), "expected dtype float64, got 'object'"),
    (truth_at(ARRAY | {"shape": [4]}), "expected 32 bytes for shape [4], got 24"),
    (truth_at(ARRAY | {"shape": [3, 1]}), "Truth.people[0].position_m: expected shape 3, got 3x1"),
    (truth_at(ARRAY | {"shape": []}), "expected 8 bytes for shape [], got 24"),
    (truth_at(ARRAY | {"shape": [-3]}), f"lengths from 0 to {MAX_BYTES}, got -3"),
    (truth_at(ARRAY | {"shape": [True, 3]}), "got True, 3"),
    (truth_at(ARRAY | {"shape": [1] * 5}), "expected a shape of at most 4 axes, got list"),
    (truth_at(ARRAY | {"data": "x"}), "expected bytes as data, got str"),
    (
        truth_at(ARRAY | {"data": np.full(3, np.nan).tobytes()}),
        "Truth.people[0].position_m: expected finite numbers of -1e+07 to 1e+07, "
        "got NaN or infinity",
    ),
    (bytes(MAX_BYTES + 1), f"expected at most {MAX_BYTES} bytes, got {MAX_BYTES + 1}"),
]


@pytest.mark.parametrize(("payload", "problem"), REFUSED, ids=[text for _, text in REFUSED])
def test_a_refusal_names_the_expected_and_the_actual_value(payload: bytes, problem: str) -> None:
    assert re.search(re.escape(problem), refusal(payload))


@pytest.mark.parametrize(
    "shape", [[2**62, 2**62], [0, 2**63], [2**64 - 1], [0, MAX_BYTES, MAX_BYTES, MAX_BYTES]]
)
def test_a_huge_declared_shape_allocates_nothing(shape: list[int]) -> None:
    payload = truth_at(ARRAY | {"shape": shape, "data": b""})
    tracemalloc.start()
    refusal(payload)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2**20


def test_a_small_payload_does_not_grow_into_millions_of_maps() -> None:
    # 256 lists of 4096 empty maps: one byte on the wire and 64 in memory for each.
    payload = b"\xdc\x01\x00" + (b"\xdc\x10\x00" + b"\x80" * 4096) * 256
    assert f"more than {MAX_CONTAINERS} lists and maps" in refusal(payload)


@pytest.mark.parametrize("depth", [50, 500, 1000, 5000])
@pytest.mark.parametrize("field", ["message", "version", "trace", "people", "foo"])
def test_deep_nesting_is_refused(field: str, depth: int) -> None:
    # A nested value in the error message must not end the process with RecursionError.
    deep = b"\x91" * depth + b"\xc0"
    fields = {name: value for name, value in TRUTH.items() if name != field}
    start = bytes([0x80 + len(fields) + 1])
    refusal(start + msgpack.packb(fields)[1:] + msgpack.packb(field) + deep)


def test_an_error_does_not_repeat_a_long_payload() -> None:
    assert len(refusal(msgpack.packb(TRUTH | {"message": "x" * 10_000}))) < 400
    assert len(refusal(truth_at(ARRAY | {"dtype": "x" * 10_000}))) < 400


def test_an_optional_field_may_be_left_out() -> None:
    fields = msgpack.unpackb(encode(BY_NAME["Truth"]))
    for person in fields["people"]:
        del person["velocity_mps"], person["yaw_rad"]
    del fields["trace"]
    again = decode(msgpack.packb(fields))
    assert again.trace == ()


def test_velocities_in_older_recordings_are_dropped() -> None:
    found = BY_NAME["Detections"]
    fields = msgpack.unpackb(encode(found)) | {"velocity_interval_s": 0.1}
    for person in fields["detections"]:
        person |= {"velocity_mps": ARRAY, "velocity_covariance_m2ps2": ARRAY}
    assert encode(decode(msgpack.packb(fields))) == encode(found)
    assert "detections" in refusal(msgpack.packb(fields | {"detections": [[1]]}))
    assert "detections" in refusal(msgpack.packb(fields | {"detections": 1}))


def test_decoded_arrays_cannot_be_written_to() -> None:
    frame: Any = decode(encode(BY_NAME["RgbdFrame"]))
    with pytest.raises(ValueError, match="read-only"):
        frame.rgb[0, 0, 0] = 1


def test_numpy_scalars_are_encoded_as_plain_numbers() -> None:
    # Integers of numpy, as from a plug-in, must be accepted.
    odometry = msgspec.structs.replace(
        BY_NAME["Odometry"], sequence=np.int64(4), x_m=np.float32(1.5), y_m=np.float64(2.5)
    )
    again: Any = decode(encode(odometry))
    assert (again.sequence, again.x_m, again.y_m) == (4, 1.5, 2.5)


FIRST_DECODE = """
import os, sys, threading
import msgpack
from people4d.codec import MESSAGES, decode
from people4d.errors import DecodeError

def decode_all():
    begin.wait()
    for payload in payloads:
        try:
            decode(payload)
        except DecodeError:
            pass

payloads = [msgpack.packb({"message": n, "version": m.VERSION}) for n, m in MESSAGES.items()]
crashed = 0
for _ in range(120):
    child = os.fork()  # before the first message, no type is examined
    if not child:
        sys.setswitchinterval(1e-6)
        begin = threading.Barrier(6)
        threads = [threading.Thread(target=decode_all) for _ in range(6)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        os._exit(0)
    crashed += os.waitpid(child, 0)[1] != 0
sys.exit(crashed)
"""


def test_first_messages_in_several_threads_do_not_crash_the_process() -> None:
    # If msgspec examines the types in several threads at once, about 5 of these 120 end by SIGSEGV.
    done = subprocess.run([sys.executable, "-c", FIRST_DECODE], check=False, timeout=100)
    assert done.returncode == 0
