"""Topics of another robot's system, as inputs of a node of ours."""

from collections.abc import Callable
from typing import TypeVar

from people4d.codec import decode
from people4d.errors import DecodeError
from people4d.messages import Message
from people4d.topics import BY_MESSAGE, ForeignTopic

M = TypeVar("M", bound=Message)


def topic_of(
    robot: str, kind: type[M], accept: Callable[[M], Message], given: type[Message] | None = None
) -> ForeignTopic:
    """Return the topic of a robot that carries one kind of message.

    Args:
        robot: Name of the robot, or of an area of a site.
        kind: Kind of its messages.
        accept: Returns the input of the node for a message, or raises DecodeError.
        given: Kind of the input of the node; None: kind.
    """
    own = BY_MESSAGE[kind]

    def decoded(payload: bytes) -> Message:
        message = decode(payload)
        if type(message) is not kind:
            expected, got = kind.__name__, type(message).__name__
            raise DecodeError(f"{own.name}: expected {expected}, got {got}")
        return accept(message)

    return ForeignTopic(
        name=own.name,
        key=own.key_expression(robot),
        message=given or kind,
        rate_hz=own.rate_hz,
        delivery=own.delivery,
        depth=own.depth,
        producer=own.producer,
        numbered=own.numbered,
        decode=decoded,
    )
