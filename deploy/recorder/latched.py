"""Last messages of latched topics, with which every part of a recording begins."""

from people4d.messages import Message
from people4d.topics import BY_MESSAGE

KEYS_MAX = 256  # latched keys whose last message is stored; more are no cameras


class LatchedMessages:
    """The last message of each latched key, in the order in which the keys came."""

    def __init__(self) -> None:
        self._messages: dict[str, Message] = {}

    def add(self, message: Message) -> bool:
        """Take a message; return True if its topic is latched."""
        topic = BY_MESSAGE[type(message)]
        if topic.delivery != "latched":
            return False
        key = topic.key_of(message, "robot")
        if key in self._messages or len(self._messages) < KEYS_MAX:
            self._messages[key] = message
        return True

    def messages(self) -> list[Message]:
        """Return the messages."""
        return list(self._messages.values())
