"""Payloads received by a Zenoh session, with bounds on their length and number of keys."""

import contextlib
import ctypes
import math
import threading
import time
from collections.abc import Iterator
from typing import Any

import zenoh

from people4d.ownership import KeyOwners
from people4d.queue import RefusedPayload
from people4d.topics import IMAGE_MAX_BYTES, KEYS_MAX

CLOSE_S = 2.0
REPORT_S = 0.1  # minimum period of the reports of messages on too many keys [s]
KEY_FORGOTTEN_S = 10.0  # minimum silence of a key before its replacement [s]


class KeyLimit:
    """Bound on the keys of a subscription, against invented names.

    Active keys stay; a new key replaces the key with the longest silence.

    Args:
        keys_max: Number of keys.
    """

    def __init__(self, keys_max: int) -> None:
        self.keys_max = keys_max
        self._heard_s: dict[str, float] = {}  # monotonic time by key, the most recent key last
        self._full_until_s = -math.inf

    def admits(self, key: str, now_s: float) -> bool:
        """Add a message; return False if there are too many other keys."""
        if self._heard_s.pop(key, None) is None:
            if now_s < self._full_until_s:
                return False
            if len(self._heard_s) >= self.keys_max:
                oldest = next(iter(self._heard_s))
                self._full_until_s = self._heard_s[oldest] + KEY_FORGOTTEN_S
                if now_s < self._full_until_s:
                    return False
                del self._heard_s[oldest]
        self._heard_s[key] = now_s
        return True


class ZenohSubscription:
    """Payloads of one topic; iterate in a thread of its own.

    Args:
        subscriber: Subscriber of Zenoh.
        max_bytes: Maximum size of a payload.
        keys_max: Maximum number of keys.
        exclude: Session whose payloads are ignored, or None.
        owners: Owners of the keys; None: keys have no owner.
    """

    def __init__(
        self,
        subscriber: Any,
        max_bytes: int = IMAGE_MAX_BYTES,
        keys_max: int = KEYS_MAX,
        exclude: str | None = None,
        owners: KeyOwners | None = None,
    ) -> None:
        self._subscriber, self._owners = subscriber, owners
        self._max_bytes = max_bytes
        self._keys = KeyLimit(keys_max)
        self._exclude = exclude
        self._closed = False
        self._receiving = threading.Lock()
        self._refused, self._reported_s = 0, -math.inf  # number of unreported messages

    def __iter__(self) -> Iterator[tuple[str, bytes]]:
        """Yield key and payload until closed, a `RefusedPayload` for a refused message.

        Messages on too many keys are reported together, at most every REPORT_S: a flood costs
        little.
        """
        while (sample := self._receive()) is not None:
            received = self._read(sample)
            is_long = len(sample.payload) > self._max_bytes
            del sample  # frees memory before the next sample
            if is_long:
                _release_memory()
            yield from received
            del received

    def samples(self) -> Iterator[Any]:
        """Yield all samples of Zenoh until closed."""
        while (sample := self._receive()) is not None:
            yield sample
            del sample  # frees memory before the next sample

    def tokens(self) -> Iterator[tuple[str, bool]]:
        """Yield keys of liveliness tokens, True for a present one, until closed."""
        for sample in self.samples():
            yield str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT

    def _read(self, sample: Any) -> list[tuple[str, bytes]]:
        """Return the payload of a sample, after a report of refused messages."""
        if sample.kind != zenoh.SampleKind.PUT or self._is_excluded(sample):
            return []
        key, now_s, size = str(sample.key_expr), time.monotonic(), len(sample.payload)
        received: list[tuple[str, bytes]] = []
        is_admitted = self._keys.admits(key, now_s)
        self._refused += not is_admitted
        if self._refused and (is_admitted or now_s - self._reported_s > REPORT_S):
            text = f"expected at most {self._keys.keys_max} publishers at once, got more"
            received.append((key, RefusedPayload(text, self._refused)))
            self._refused, self._reported_s = 0, now_s
        if is_admitted and size > self._max_bytes:
            text = f"expected at most {self._max_bytes} bytes, got {size}"
            received.append((key, RefusedPayload(text)))
        elif is_admitted and self._owners:
            payload = sample.payload.to_bytes()
            owned = self._owners.receive(key, session_of(sample), payload)
            received += [(key, one) for one in owned]
        elif is_admitted:
            received.append((key, sample.payload.to_bytes()))
        return received

    def _is_excluded(self, sample: Any) -> bool:
        # The cache of this session also replies to its own subscribers.
        return self._exclude is not None and session_of(sample) == self._exclude

    def _receive(self) -> Any:
        """Wait for a sample; None once closed."""
        try:
            with self._receiving:
                return None if self._closed else self._subscriber.handler.recv()
        except zenoh.ZError:
            return None

    @property
    def closed(self) -> bool:
        """True once the iteration was ended."""
        return self._closed

    def close(self) -> None:
        """End the iteration."""
        if not self._closed:
            self._closed = True
            self._subscriber.undeclare()
            # Python aborts if it ends while a thread is still inside of Zenoh.
            if self._receiving.acquire(timeout=CLOSE_S):
                self._receiving.release()


def session_of(sample: Any) -> str:
    """Return the session of a sample, empty if it is unknown."""
    source = sample.source_info
    return "" if source is None else str(source.source_id.zid)


def _release_memory() -> None:
    """Return freed memory to the system, if the C library supports it.

    Zenoh receives a long payload in pieces, which otherwise stay in the arenas of its threads.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
