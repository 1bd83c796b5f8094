"""Web address as a receiver of events."""

import io
import socket
import time
from http.client import HTTPConnection, HTTPResponse, HTTPSConnection
from urllib.parse import urlsplit

from people4d.errors import ConfigError
from people4d.messages import Event
from services.events.delivery import TIMEOUT_S

CONNECTIONS = {"http": HTTPConnection, "https": HTTPSConnection}
HEAD_MAX = 65536  # maximum head of an answer [bytes]
HEAD_END = b"\r\n\r\n"


class Webhook:
    """Receiver of events by HTTP: one POST with JSON for each, without redirects.

    Args:
        url: Address, http or https.
        robot: Name of the robot.

    Raises:
        ConfigError: The address is invalid.
    """

    name = "webhook"

    def __init__(self, url: str, robot: str) -> None:
        self._robot = robot
        try:
            parts = urlsplit(url)
            self._host, self._port = parts.hostname or "", parts.port
        except ValueError:
            self._host = ""
        if not self._host or parts.scheme not in CONNECTIONS or parts.username or not url.isascii():
            raise ConfigError(
                f"events.webhook is not an address: {url!r}", "Write: http://192.168.1.9/events."
            )
        self._connection = CONNECTIONS[parts.scheme]
        self._target = f"{parts.path or '/'}{'?' if parts.query else ''}{parts.query}"

    def send(self, event: Event, body: bytes) -> None:
        """Post an event; OSError or HTTPException unless the answer is 200 to 299 in time."""
        end_s = time.monotonic() + TIMEOUT_S
        headers = {
            "Content-Type": "application/json",
            "Idempotency-Key": f"{self._robot}-{event.sequence}",
        }
        connection = self._connection(self._host, self._port, timeout=TIMEOUT_S)
        try:
            connection.connect()
            connection.sock.settimeout(_left_s(end_s))
            connection.request("POST", self._target, body, headers)
            status = _status(connection.sock, end_s)
        finally:
            connection.close()
        if not 200 <= status <= 299:
            raise OSError(f"it answers {status}")

    def close(self) -> None:
        """Do nothing, since no connection stays open."""


def _status(sock: socket.socket, end_s: float) -> int:
    """Return the status of an answer whose head arrives before a deadline."""
    head = b""
    while HEAD_END not in head and len(head) <= HEAD_MAX:
        sock.settimeout(_left_s(end_s))
        received = sock.recv(4096)
        if not received:
            break
        head += received
    response = HTTPResponse(sock)
    response.fp = io.BufferedReader(io.BytesIO(head))
    response.begin()
    return response.status


def _left_s(end_s: float) -> float:
    """Return the time until a deadline; TimeoutError after it."""
    left_s = end_s - time.monotonic()
    if left_s <= 0:
        raise TimeoutError(f"no answer within {TIMEOUT_S:g} s")
    return left_s
