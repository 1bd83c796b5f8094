"""Live truth: people_msgs/People in CDR, as zenoh-bridge-ros2dds passes it on."""

from collections.abc import Iterator, Sequence
from typing import Any

from common.io.ros_bag import PEOPLE
from common.io.ros_cdr import cdr_decoder, parse_key
from people4d.errors import DecodeError
from people4d.messages import Truth
from people4d.topics import ForeignTopic
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.sources.people_msgs import people_typestore, truth_of


class LiveTruth:
    """The People messages on a key, for example "vicon/people" of the ROS topic /vicon/people.

    Raises:
        ConfigError: The key is not one.
    """

    def __init__(self, config: GtBridgeConfig) -> None:
        key = parse_key("truth", config.truth, "vicon/people")
        self.decode = cdr_decoder(people_typestore(), PEOPLE, _stamped)
        self.topics: Sequence[ForeignTopic] = (
            ForeignTopic("captured", key, Truth, 100, "queue", 256, "motion capture", self.decode),
        )

    def __iter__(self) -> Iterator[Truth]:
        """Yield nothing: live truth comes as messages."""
        return iter(())


def _stamped(message: Any) -> Truth:
    truth = truth_of(message, 0)
    if truth.stamp_ns == 0:
        raise DecodeError(
            "people: expected the time of capture in header.stamp, got 0",
            "Let the motion-capture node stamp its messages.",
        )
    return truth
