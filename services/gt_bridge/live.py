"""Truth that is captured now: people_msgs/People in CDR, as zenoh-bridge-ros2dds passes it on."""

import re
from collections.abc import Iterator, Sequence

from common.errors import ConfigError, DecodeError
from common.messages import Message, Truth
from common.topics import ForeignTopic
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.people_msgs import PEOPLE, people_typestore, truth_of
from services.gt_bridge.sources import SCHEME

# Chunks without the wild cards of Zenoh, blanks, or what no name of a ROS topic has.
KEY = re.compile(r"[A-Za-z0-9_~.%@-]{1,64}(/[A-Za-z0-9_~.%@-]{1,64}){0,31}")
MAX_BYTES = 2**20  # 4000 people need half of it


class LiveTruth:
    """The People messages on a key, for example "vicon/people" of the ROS topic /vicon/people.

    Raises:
        ConfigError: The key is not one.
    """

    def __init__(self, config: GtBridgeConfig) -> None:
        key = config.truth.removeprefix(SCHEME).strip("/")
        if not KEY.fullmatch(key):
            raise ConfigError(
                f"truth {config.truth!r:.80} names no key",
                "Write zenoh: and the ROS topic, for example zenoh:vicon/people.",
            )
        self._store = people_typestore()
        self.topics: Sequence[ForeignTopic] = (
            ForeignTopic("captured", key, Truth, 100, "queue", 256, "motion capture", self.decode),
        )

    def __iter__(self) -> Iterator[Truth]:
        """Yield nothing: what is captured comes as messages."""
        return iter(())

    def decode(self, payload: bytes) -> Message:
        """Read one message.

        Args:
            payload: CDR with its header of 4 bytes, untrusted.

        Raises:
            DecodeError: The bytes are no people_msgs/People, or it has no time.
        """
        if len(payload) > MAX_BYTES:
            raise DecodeError(f"people: expected at most {MAX_BYTES} bytes, got {len(payload)}")
        try:
            truth = truth_of(self._store.deserialize_cdr(payload, PEOPLE), 0)
        except Exception as error:  # damaged bytes make rosbags raise almost anything
            reason = f"{type(error).__name__} {error}"[:80].strip()
            raise DecodeError(f"people: expected {PEOPLE} in CDR, got {reason}") from error
        if truth.stamp_ns == 0:
            raise DecodeError(
                "people: expected the time of capture in header.stamp, got 0",
                "Let the motion-capture node stamp its messages.",
            )
        return truth
