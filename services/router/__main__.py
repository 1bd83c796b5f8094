"""Run the router; its process needs no node of its own, only the session."""

import sys
from collections.abc import Sequence
from typing import ClassVar

import msgspec

from common import process
from common.messages import Message
from common.node import Node, Status


class RouterConfig(msgspec.Struct, frozen=True, kw_only=True):
    """Nothing to configure here: endpoints and access are in the Zenoh configuration."""


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


def build(config: RouterConfig) -> Node:  # noqa: ARG001
    """Make the node."""
    return RouterNode()


def main() -> int:
    """Run the service."""
    return process.main("router", RouterConfig, build, mode="router")


if __name__ == "__main__":
    sys.exit(main())
