"""Queue of messages from the transport's threads to the source's thread."""

import threading
import time
from collections import Counter, deque
from dataclasses import dataclass

IMAGES_MAX = 4  # maximum number of waiting images of one topic; the oldest are dropped
OTHERS_MAX = 1024  # maximum number of waiting messages of other topics


@dataclass(frozen=True, slots=True)
class TopicSample:
    """A received message."""

    topic: str
    cdr: bytes
    received_ns: int  # [ns] time of sending if known, else of reception


class SampleQueue:
    """Queue of messages in the order of arrival, bounded by topic.

    Attributes:
        last_s: Monotonic time of the last message of each topic [s].
    """

    def __init__(self, counters: Counter[str]) -> None:
        self._counters = counters
        self._samples: deque[TopicSample] = deque()
        self._waiting: Counter[str] = Counter()
        self._changed = threading.Condition()
        self._closed = False
        self.last_s: dict[str, float] = {}

    def add_sample(self, topic: str, cdr: bytes, sent_ns: int, most: int) -> None:
        """Add a message; of more than `most` of its topic the oldest is dropped and counted."""
        with self._changed:
            self.last_s[topic] = time.monotonic()
            self._samples.append(TopicSample(topic, cdr, sent_ns or time.time_ns()))
            self._waiting[topic] += 1
            if self._waiting[topic] > most:
                oldest = next(sample for sample in self._samples if sample.topic == topic)
                self._samples.remove(oldest)
                self._waiting[topic] -= 1
                self._counters["skipped_messages"] += 1
            self._changed.notify()

    def get(self, timeout_s: float) -> TopicSample | None:
        """Return the oldest message, None after the timeout or if the queue is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._samples or self._closed, timeout_s)
            if self._closed or not self._samples:
                return None
            sample = self._samples.popleft()
            self._waiting[sample.topic] -= 1
            return sample

    @property
    def closed(self) -> bool:
        """True if the queue returns no more messages."""
        return self._closed

    def clear(self) -> None:
        """Drop all waiting messages."""
        with self._changed:
            self._samples.clear()
            self._waiting.clear()
            self.last_s.clear()

    def close(self) -> None:
        """Make `get` return immediately."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
