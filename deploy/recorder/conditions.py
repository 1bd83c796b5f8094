"""Conditions for writing the messages in a recorder's memory."""

from people4d.errors import ConfigError
from people4d.messages import Message, Tracks
from people4d.topics import BY_NAME

PERSON = "person"
IDENTITIES_MAX = 10_000  # maximum number of stored identities


class Condition:
    """Return copied images as a frame, depth in millimetres; SourceError if unusable."""

    def __init__(self, name: str) -> None:
        if name != PERSON and name not in BY_NAME:
            raise ConfigError(
                f"unknown condition {name!r}", f"It is {PERSON} or a topic: {', '.join(BY_NAME)}."
            )
        # Type of the messages that can meet the condition
        self.message: type[Message] = Tracks if name == PERSON else BY_NAME[name].message
        self._on_person = name == PERSON
        self._known: dict[int, None] = {}

    def is_met(self, message: Message) -> bool:
        """Check a message; each message is checked once, in order."""
        if not (self._on_person and isinstance(message, Tracks)):
            return isinstance(message, self.message)
        confirmed = dict.fromkeys(t.id for t in message.tracks if t.state == "confirmed")
        is_new = bool(confirmed.keys() - self._known.keys())
        self._known |= confirmed
        while len(self._known) > IDENTITIES_MAX:
            del self._known[next(iter(self._known))]
        return is_new
