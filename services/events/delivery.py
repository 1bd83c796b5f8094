"""Delivery of events to a receiver outside; what it does not take is tried again, in order."""

import json
import sqlite3
import threading
from pathlib import Path
from typing import Protocol

import msgspec

from people4d.messages import Event
from services.events.journal import Journal

TIMEOUT_S = 5.0
WAITS_S = (1.0, 2.0, 5.0, 10.0, 30.0)
BATCH = 100


class Receiver(Protocol):
    """Receiver of events: a web address, or a broker of MQTT."""

    name: str

    def send(self, event: Event, body: bytes) -> None:
        """Return once it has taken the event; OSError or ValueError if it does not."""

    def close(self) -> None:
        """Close its connection."""


class Delivery:
    """Sends each event of a journal once it is taken, from a thread of its own.

    Args:
        receiver: Where to.
        file: The journal.
        robot: Name of the robot, part of each event.
    """

    def __init__(self, receiver: Receiver, file: Path, robot: str) -> None:
        self._receiver, self._file, self._robot = receiver, file, robot
        self.problem = ""
        self._sent, self._failed = f"{receiver.name}_sent", f"{receiver.name}_failed"
        self.counters = {self._sent: 0, self._failed: 0}
        self._due = threading.Event()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name=receiver.name, daemon=True)
        self._thread.start()

    def wake(self) -> None:
        """Send what is new."""
        self._due.set()

    def close(self) -> None:
        """End it; what was not taken is sent after the next start."""
        self._closed = True
        self._due.set()
        self._thread.join(TIMEOUT_S + 1)

    def _run(self) -> None:
        journal = Journal(self._file, 1)
        failures = 0
        self._due.set()
        while not self._closed:
            self._due.wait(None if not failures else WAITS_S[min(failures, len(WAITS_S)) - 1])
            self._due.clear()
            failures = 0 if self._send_all(journal) else failures + 1
        self._receiver.close()
        journal.close()

    def _send_all(self, journal: Journal) -> bool:
        """Send what waits; return False if that failed."""
        name = self._receiver.name
        try:
            while events := journal.after(journal.mark(name), BATCH):
                for event in events:
                    if self._closed:
                        return True
                    self._receiver.send(event, self._body(event))
                    journal.set_mark(name, event.sequence)
                    self.counters[self._sent] += 1
        except (OSError, ValueError, sqlite3.Error) as error:
            self.counters[self._failed] += 1
            self.problem = f"{name} does not take events ({error}); they wait in the journal"
            return False
        self.problem = ""
        return True

    def _body(self, event: Event) -> bytes:
        fields = msgspec.to_builtins(event, enc_hook=lambda array: array.tolist())
        fields.pop("trace")
        return json.dumps({"robot": self._robot, **fields}).encode()
