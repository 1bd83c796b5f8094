"""The dashboard and the events as processes, with simulated people."""

import socket
import subprocess
import time
from pathlib import Path
from typing import Self

from msgspec.structs import replace

from common.transport.ports import free_port
from people4d.messages import Health, Message, Tracks
from scripts.dashboard_feed import Feed, FeedThread
from tests.integration.processes import start
from tests.network import Network

HOSTILE = "<img src=x onerror=window.hacked=1>"
OPERATOR, PLANNER = "operator-of-the-test", "planner-of-the-test"
SETTINGS: dict[str, tuple[str, ...]] = {
    "dashboard": (f"operator_token={OPERATOR}", f"planner_token={PLANNER}"),
    "events": (),
}
START_S = 100.0
RATE_HZ = 5.0
PEOPLE = 3
WIDTH_PX = 320


class HostileFeed(Feed):
    """A feed whose texts try to be markup."""

    def frame(self, sequence: int, stamp_ns: int, lockstep: bool = False) -> list[Message]:
        """Return the messages of one frame."""
        messages = super().frame(sequence, stamp_ns, lockstep)
        return [self._changed(message) for message in messages]

    def healths(self, sequence: int) -> list[Health]:
        """Return a heartbeat of every service."""
        first, *others = super().healths(sequence)
        return [replace(first, state="degraded", reason=HOSTILE), *others]

    def _changed(self, message: Message) -> Message:
        if not isinstance(message, Tracks):
            return message
        first, *others = message.tracks
        return replace(message, tracks=(replace(first, identity_reason=HOSTILE), *others))


class Stack:
    """Router, dashboard, events, and a feed of three people, until the block ends."""

    def __init__(self, folder: Path) -> None:
        self.network, self._folder = Network(), folder
        self._robot, self._port = self.network.robot(), free_port()
        self.url = f"http://127.0.0.1:{self._port}/"
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._feed: FeedThread | None = None

    def __enter__(self) -> Self:
        """Start everything, and wait until the page is served."""
        self.start_all()
        feed = HostileFeed(PEOPLE, WIDTH_PX)
        self.bus = self.network.open(self._robot)
        self._feed = FeedThread(self.bus, feed, RATE_HZ)
        return self

    def __exit__(self, *_: object) -> None:
        """End everything."""
        if self._feed:
            self._feed.close()
        for service in self._processes:
            self.kill(service)
        self.network.close()

    def start(self, service: str) -> None:
        """Start a service."""
        settings = [*SETTINGS[service], *([f"port={self._port}"] * (service == "dashboard"))]
        self._processes[service] = start(
            *(self.network, self._robot, f"{service}-1", settings), PEOPLE4D_STATE=str(self._folder)
        )

    def start_all(self) -> None:
        """Start all services, and wait until the page is served."""
        for service in SETTINGS:
            self.start(service)
        end_s = time.monotonic() + START_S
        while not _answers(self._port):
            if time.monotonic() > end_s:
                raise TimeoutError("the dashboard does not start")
            time.sleep(0.1)

    def kill(self, service: str) -> None:
        """End a service at once."""
        process = self._processes[service]
        process.kill()
        process.wait()


def _answers(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port), 1).close()
    except OSError:
        return False
    return True
