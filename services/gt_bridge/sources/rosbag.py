"""Truth from people_msgs/People in ROS 1 and ROS 2 bags."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from common.io.ros_bag import PEOPLE, PEOPLE_DEFINITIONS, open_bag
from people4d.errors import SourceError
from people4d.messages import Truth
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.sources.people_msgs import truth_of


class RosbagTruth:
    """The People messages of one topic of a bag.

    Raises:
        SourceError: The bag cannot be read, has no such topic, or has several and none is named.
    """

    def __init__(self, config: GtBridgeConfig) -> None:
        self._path = Path(config.truth)
        with open_bag(self._path, PEOPLE_DEFINITIONS) as bag:
            self._topic = self._choose(config.topic, bag.types)

    def __iter__(self) -> Iterator[Truth]:
        """Yield the messages in the order in which they were recorded.

        Raises:
            SourceError: The bag is damaged, or its frame has a name that cannot be used.
        """
        with open_bag(self._path, PEOPLE_DEFINITIONS) as bag:
            for sequence, (_, _, message) in enumerate(bag.messages([self._topic])):
                try:
                    truth = truth_of(message, sequence)
                except ValueError as error:
                    raise SourceError(f"truth {self._path}: {error}") from error
                yield truth
            if bag.bad_messages:
                raise SourceError(f"truth {self._path}: {bag.bad_messages} messages cannot be read")

    def _choose(self, wanted: str, types: Mapping[str, str]) -> str:
        """Return the wanted topic; empty where the bag holds no truth."""
        topics = sorted(topic for topic, kind in types.items() if kind == PEOPLE)
        if wanted and wanted not in topics:
            raise SourceError(
                f"truth {self._path} has no topic {wanted} of people_msgs/People",
                f"It has {', '.join(topics) or 'none of that type'}.",
            )
        if not wanted and len(topics) > 1:
            raise SourceError(
                f"truth {self._path} has {len(topics)} topics of people_msgs/People",
                f"Set topic to one of {', '.join(topics)}.",
            )
        return wanted or (topics[0] if topics else "")
