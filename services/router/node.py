"""The router as a node: it lives, and Zenoh does the routing."""

from collections.abc import Sequence
from typing import ClassVar

from common.runtime.node import Status
from people4d.messages import Message


class RouterNode:
    """Only tells that the router lives; Zenoh does the routing."""

    inputs: ClassVar[tuple[type[Message], ...]] = ()

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Take nothing."""
        return ()

    def tick(self, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Have nothing due."""
        return ()

    def wake_ns(self) -> int | None:
        """Want no tick."""
        return None

    def status(self) -> Status:
        """Be ready."""
        return Status()

    def close(self) -> None:
        """Hold nothing."""
