"""Conditions at which a recorder writes what it holds in memory."""

from typing import Protocol

from people4d.errors import ConfigError
from people4d.messages import Message, Tracks
from people4d.topics import BY_NAME

PERSON = "person"
IDENTITIES_MAX = 10_000  # whose first time is stored


class Condition(Protocol):
    """A condition on messages."""

    message: type[Message]  # the only type of messages that can meet it

    def is_met(self, message: Message) -> bool:
        """Check a message, each once and in order."""
        ...


class PersonEnters:
    """Met by the first message in which an identity is confirmed."""

    message: type[Message] = Tracks

    def __init__(self) -> None:
        self._known: dict[int, None] = {}

    def is_met(self, message: Message) -> bool:
        """Check for a confirmed identity that no message before had."""
        if not isinstance(message, Tracks):
            return False
        new = [
            track.id
            for track in message.tracks
            if track.state == "confirmed" and track.id not in self._known
        ]
        self._known |= dict.fromkeys(new)
        while len(self._known) > IDENTITIES_MAX:
            del self._known[next(iter(self._known))]
        return bool(new)


class TopicPublishes:
    """Met by every message of one type."""

    def __init__(self, message: type[Message]) -> None:
        self.message = message

    def is_met(self, message: Message) -> bool:
        """Check the type of a message."""
        return isinstance(message, self.message)


def condition_of(name: str) -> Condition:
    """Return the condition of a name: "person", or a topic such as "events".

    Raises:
        ConfigError: There is neither such a condition nor such a topic.
    """
    if name == PERSON:
        return PersonEnters()
    if name in BY_NAME:
        return TopicPublishes(BY_NAME[name].message)
    raise ConfigError(
        f"there is no condition {name!r}", f"It is {PERSON} or a topic: {', '.join(BY_NAME)}."
    )
