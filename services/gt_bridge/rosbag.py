"""Truth from people_msgs/People in ROS 1 and ROS 2 bags."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from common.errors import SourceError
from common.messages import Truth
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.people_msgs import PEOPLE, people_typestore, truth_of


class RosbagTruth:
    """The People messages of one topic of a bag.

    Raises:
        SourceError: The bag cannot be read, has no such topic, or has several and none is named.
    """

    def __init__(self, config: GtBridgeConfig) -> None:
        self._path = Path(config.truth)
        self._topic = config.topic
        for _ in self._messages(limit=0):
            pass  # opened once, so that a wrong bag is told at the start

    def __iter__(self) -> Iterator[Truth]:
        """Yield the messages in the order in which they were recorded.

        Raises:
            SourceError: The bag is damaged, or its frame has a name that cannot be used.
        """
        for sequence, message in enumerate(self._messages()):
            try:
                truth = truth_of(message, sequence)
            except ValueError as error:
                raise SourceError(f"truth {self._path}: {error}") from error
            yield truth

    def _messages(self, limit: int | None = None) -> Iterator[Any]:
        # Bags that carry no definitions get ours; ROS 1 bags always carry theirs.
        try:
            with AnyReader([self._path], default_typestore=people_typestore()) as reader:
                chosen = self._choose(reader.connections)
                if limit == 0 or not chosen:
                    return
                for connection, _, data in reader.messages(chosen):
                    yield reader.deserialize(data, connection.msgtype)
        except SourceError:
            raise
        except Exception as error:  # a damaged bag makes rosbags raise almost anything
            raise SourceError(
                f"truth {self._path} cannot be read as a ROS bag: {error}", "Check the path."
            ) from error

    def _choose(self, connections: list[Connection]) -> list[Connection]:
        """Return the connections of the wanted topic; none where the bag holds no truth."""
        people = [c for c in connections if c.msgtype == PEOPLE]
        topics = sorted({c.topic for c in people})
        if self._topic and self._topic not in topics:
            raise SourceError(
                f"truth {self._path} has no topic {self._topic} of people_msgs/People",
                f"It has {', '.join(topics) or 'none of that type'}.",
            )
        if not self._topic and len(topics) > 1:
            raise SourceError(
                f"truth {self._path} has {len(topics)} topics of people_msgs/People",
                f"Set topic to one of {', '.join(topics)}.",
            )
        return [c for c in people if c.topic in (self._topic or topics[0])] if topics else []
