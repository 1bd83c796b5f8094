"""Publisher of one key of a Zenoh session."""

import time
from typing import Any

import zenoh
import zenoh.ext

from people4d.topics import Topic

UNSURE_S = 1.0  # time from the first message of a key until its subscribers are known [s]


class Publisher:
    """Publisher of one key.

    Args:
        session: Session of Zenoh.
        topic: Topic of the key.
        key: Full key.
        lossless: True: a slow subscriber delays the publisher.
        to: Locality of the subscribers.
    """

    def __init__(
        self, session: zenoh.Session, topic: Topic, key: str, lossless: bool, to: zenoh.Locality
    ) -> None:
        self.topic = topic
        self._session, self._key, self._lossless, self._to = session, key, lossless, to
        self._declared = self._declare()
        self._since_s = time.monotonic()
        self._sent = 0
        self._last = b""  # last message of a latched topic
        self.is_copied = False  # True if another session sends in the name of this publisher

    def is_wanted(self) -> bool:
        """Check that another session may subscribe to the key."""
        # Late joiners get the last message of a latched topic.
        if self.topic.delivery == "latched" or time.monotonic() - self._since_s < UNSURE_S:
            return True
        matching: bool = self._declared.matching_status.matching
        return matching

    def send(self, payload: bytes) -> None:
        """Send a payload."""
        self._sent += 1
        if self.topic.delivery == "latched":
            self._last = payload
            self._declared.put(payload)
        elif self.topic.owned:
            source = zenoh.SourceInfo(self._declared.id, self._sent)
            self._declared.put(payload, source_info=source)
        else:
            self._declared.put(payload)

    def repeat(self) -> None:
        """Repeat the last message of a latched topic.

        After a forged message in its name the publisher changes its name, since subscribers skip
        lower numbers of the old one.
        """
        if self.is_copied:
            self.is_copied = False
            self._declared.undeclare()
            self._declared = self._declare()
        if self._last:
            self._declared.put(self._last)

    def _declare(self) -> Any:
        # A slow link must not delay live frames, nor a hung subscriber the heartbeat. Latched
        # messages are repeated. All others are small, so the publisher waits.
        topic = self.topic
        wait = self._lossless or (topic.delivery == "queue" and topic.waits)
        control = zenoh.CongestionControl.BLOCK if wait else zenoh.CongestionControl.DROP
        if topic.delivery == "latched":
            return zenoh.ext.declare_advanced_publisher(
                self._session,
                self._key,
                congestion_control=control,
                allowed_destination=self._to,
                cache=zenoh.ext.CacheConfig(max_samples=1),
                publisher_detection=True,
                # Messages are numbered, since sessions do not stamp them.
                sample_miss_detection=zenoh.ext.MissDetectionConfig(
                    heartbeat=None, sporadic_heartbeat=None
                ),
            )
        return self._session.declare_publisher(
            self._key, congestion_control=control, express=True, allowed_destination=self._to
        )
