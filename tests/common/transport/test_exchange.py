"""Messages handed over inside a process equal decoded messages."""

from typing import Any

import msgspec
import numpy as np
import pytest

from common.transport.exchange import Exchange, as_received, size_of
from people4d.codec import decode, encode
from people4d.messages import Message, RgbdFrame
from people4d.topics import BY_MESSAGE, Topic
from tests.contract.examples import BY_NAME, FULL, RGB, SPARSE

FRAMES = BY_MESSAGE[RgbdFrame]
FRAME = BY_NAME["RgbdFrame"]


def differences(one: Any, other: Any, path: str) -> list[str]:
    """Return the paths at which two values differ in type, content or writability."""
    if type(one) is not type(other):
        return [f"{path}: {type(one).__name__} and {type(other).__name__}"]
    if isinstance(one, msgspec.Struct):
        pairs = [(n, getattr(one, n), getattr(other, n)) for n in one.__struct_fields__]
    elif isinstance(one, dict):
        pairs = [(name, one[name], other.get(name)) for name in one]
    elif isinstance(one, tuple):
        pairs = [(str(k), a, b) for k, (a, b) in enumerate(zip(one, other, strict=True))]
    elif isinstance(one, np.ndarray):
        same = one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype != bool)
        flags = (one.flags.writeable, one.flags.c_contiguous)
        same &= flags == (other.flags.writeable, other.flags.c_contiguous)
        return [] if same else [f"{path}: arrays differ"]
    else:
        return [] if one == other or one != one else [f"{path}: {one!r} and {other!r}"]
    return [text for name, a, b in pairs for text in differences(a, b, f"{path}.{name}")]


@pytest.mark.parametrize("message", [*FULL, *SPARSE], ids=lambda m: type(m).__name__)
def test_a_message_handed_over_is_what_a_receiver_decodes(message: Message) -> None:
    assert differences(as_received(message), decode(encode(message)), "message") == []


def test_numbers_and_arrays_of_numpy_become_what_a_receiver_decodes() -> None:
    turned = np.asfortranarray(RGB)
    message = msgspec.structs.replace(
        FRAME, rgb=turned, stamp_ns=np.int64(7), sequence=np.uint8(3), lockstep=np.bool_(True)
    )
    assert differences(as_received(message), decode(encode(message)), "message") == []


def test_images_are_handed_over_without_a_copy_and_stay_writeable_for_their_maker() -> None:
    rgb = RGB.copy()
    message = as_received(msgspec.structs.replace(FRAME, rgb=rgb))
    assert isinstance(message, RgbdFrame)
    assert np.shares_memory(message.rgb, rgb)
    assert not message.rgb.flags.writeable
    assert rgb.flags.writeable
    assert size_of(message) == message.rgb.nbytes + message.depth_mm.nbytes


class Inbox:
    """Messages that were handed over."""

    def __init__(self) -> None:
        self.got: list[tuple[str, Message]] = []

    def take(self, topic: Topic, key: str, message: Message) -> None:
        assert topic is BY_MESSAGE[type(message)]
        self.got.append((key, message))


def test_every_subscriber_gets_the_same_object_until_it_ends() -> None:
    exchange, first, second = Exchange(), Inbox(), Inbox()
    one = exchange.subscribe(FRAMES, first.take)
    two = exchange.subscribe(FRAMES, second.take)
    exchange.publish(FRAMES, "key", FRAME)
    assert first.got[0][1] is second.got[0][1]
    one.close()
    exchange.publish(FRAMES, "key", FRAME)
    two.close()
    exchange.publish(FRAMES, "key", FRAME)
    assert (len(first.got), len(second.got)) == (1, 2)


def test_a_late_subscriber_gets_the_last_of_each_key_of_a_latched_topic_only() -> None:
    info, exchange, late = BY_NAME["CameraInfo"], Exchange(), Inbox()
    topic = BY_MESSAGE[type(info)]
    newer = msgspec.structs.replace(info, sequence=info.sequence + 1)
    for key, message in (("a", info), ("a", newer), ("b", info)):
        exchange.publish(topic, key, message)
    exchange.publish(FRAMES, "key", FRAME)
    exchange.subscribe(topic, late.take)
    exchange.subscribe(FRAMES, late.take)
    assert [(key, message.sequence) for key, message in late.got] == [
        ("a", newer.sequence),
        ("b", info.sequence),
    ]
