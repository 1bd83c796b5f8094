"""Web address that events are posted to."""

import contextlib
import urllib.request

from people4d.messages import Event
from services.events.delivery import TIMEOUT_S


class Webhook:
    """Receiver of events by HTTP: one POST with JSON for each.

    Args:
        url: Address, http or https.
        robot: Name of the robot.
    """

    name = "webhook"

    def __init__(self, url: str, robot: str) -> None:
        self._url, self._robot = url, robot

    def send(self, event: Event, body: bytes) -> None:
        """Post an event; OSError unless the answer is 200 to 299."""
        headers = {
            "Content-Type": "application/json",
            "Idempotency-Key": f"{self._robot}-{event.sequence}",
        }
        request = urllib.request.Request(self._url, body, headers, method="POST")
        with contextlib.closing(urllib.request.urlopen(request, timeout=TIMEOUT_S)):
            pass

    def close(self) -> None:
        """Nothing stays open."""
