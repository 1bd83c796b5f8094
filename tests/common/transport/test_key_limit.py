"""Bound on the keys of a subscription."""

from types import SimpleNamespace
from typing import Any

import zenoh

from people4d.queue import MessageQueue
from people4d.subscription import KEY_FORGOTTEN_S, KeyLimit, ZenohSubscription
from people4d.topics import BY_NAME


def test_of_too_many_keys_the_first_go_on_and_others_are_refused() -> None:
    limit = KeyLimit(3)
    for second in range(100):
        assert all(limit.admits(key, second) for key in "abc")
        assert not limit.admits(f"invented{second}", second)


def test_key_that_was_silent_for_long_makes_room() -> None:
    limit = KeyLimit(2)
    assert limit.admits("a", 0.0)
    assert limit.admits("b", 1.0)
    assert not limit.admits("c", KEY_FORGOTTEN_S - 0.1)
    assert limit.admits("a", KEY_FORGOTTEN_S)
    assert not limit.admits("c", KEY_FORGOTTEN_S + 0.9)
    assert limit.admits("c", KEY_FORGOTTEN_S + 1.0)  # in place of b, not of a
    assert limit.admits("a", KEY_FORGOTTEN_S + 1.0)
    assert not limit.admits("b", KEY_FORGOTTEN_S + 1.0)


class Received:
    """Stands for a subscriber that has received samples, and is closed."""

    def __init__(self, *samples: Any) -> None:
        self.handler, self._samples = self, list(samples)

    def recv(self) -> Any:
        return self._samples.pop(0) if self._samples else None


def sample(key: str) -> Any:
    payload = zenoh.ZBytes(b"no message")
    return SimpleNamespace(kind=zenoh.SampleKind.PUT, key_expr=key, payload=payload)


def test_messages_on_too_many_keys_are_counted_together() -> None:
    invented = [sample(f"invented{number}") for number in range(500)]
    received = Received(sample("known"), *invented, sample("known"))
    subscription = ZenohSubscription(received, keys_max=1)
    payloads = [(key, getattr(payload, "number", None)) for key, payload in subscription]
    reports = [number for _, number in payloads if number]
    assert sum(reports) == 500
    assert len(reports) < 50  # of 500 within milliseconds
    assert [key for key, number in payloads if not number] == ["known", "known"]


def test_each_message_on_too_many_keys_counts_as_bad() -> None:
    invented = [sample(f"invented{number}") for number in range(9)]
    subscription = ZenohSubscription(
        Received(sample("known"), *invented, sample("known")), keys_max=1
    )
    queue = MessageQueue()
    queue.follow(subscription, BY_NAME["detections"]).join()
    assert queue.counters["bad_detections"] == 9 + 2  # the payload of the known key is invalid, too
