"""Delivery of events to an external receiver, in order, with retries."""

import threading
import time
from pathlib import Path
from typing import Protocol

from common.io.plain_json import to_json
from people4d.messages import Event
from services.events.journal import Journal

TIMEOUT_S = 5.0  # maximum duration of one delivery [s]
WAITS_S = (0.0, 1.0, 2.0, 5.0, 10.0, 30.0)  # wait before an attempt, by number of failures [s]
BATCH = 100  # number of events read from the journal at once


class Receiver(Protocol):
    """Receiver of events: a web address or an MQTT broker."""

    name: str

    def send(self, event: Event, body: bytes) -> None:
        """Deliver an event within TIMEOUT_S; raise if that fails."""

    def close(self) -> None:
        """Close the connection."""


class Delivery:
    """Sends the events of a journal from its own thread, each until it is accepted.

    Args:
        receiver: Receiver of the events.
        file: File of the journal.
        robot: Name of the robot, part of each event.
    """

    def __init__(self, receiver: Receiver, file: Path, robot: str) -> None:
        self._receiver, self._file, self._robot = receiver, file, robot
        self._journal: Journal | None = None
        self._problem = ""
        self._sending_s: float | None = None  # monotonic start of the current attempt
        self._sent, self._failed = f"{receiver.name}_sent", f"{receiver.name}_failed"
        self.counters = {self._sent: 0, self._failed: 0}
        self._due = threading.Event()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name=receiver.name, daemon=True)
        self._thread.start()

    @property
    def problem(self) -> str:
        """Message on waiting events; empty if none wait."""
        sending_s = self._sending_s
        held_s = 0.0 if sending_s is None else time.monotonic() - sending_s
        if held_s > TIMEOUT_S + 1:  # for example a slow name look-up
            return self._waiting(f"no answer for {held_s:.0f} s")
        return self._problem

    def wake(self) -> None:
        """Send new events."""
        self._due.set()

    def close(self) -> None:
        """End the thread; remaining events are sent after the next start."""
        self._closed.set()
        self._due.set()
        self._thread.join(TIMEOUT_S + 1)

    def _run(self) -> None:
        failures = 0
        self._due.set()
        while not self._closed.wait(WAITS_S[failures]):
            self._due.wait()
            self._due.clear()
            if self._closed.is_set():
                break
            if self._try_all():
                failures = 0
            else:
                failures = min(failures + 1, len(WAITS_S) - 1)
                self._due.set()
        self._receiver.close()
        self._close_journal()

    def _try_all(self) -> bool:
        """Send all waiting events; return False after any failure."""
        try:
            self._journal = self._journal or Journal(self._file, 1)
            self._send_all(self._journal)
        except Exception as error:  # an answer may cause errors in any library
            self.counters[self._failed] += 1
            self._problem = self._waiting(" ".join(str(error).split()) or type(error).__name__)
            self._close_journal()
            return False
        finally:
            self._sending_s = None
        self._problem = ""
        return True

    def _send_all(self, journal: Journal) -> None:
        name = self._receiver.name
        while events := journal.after(journal.mark(name), BATCH):
            for event in events:
                if self._closed.is_set():
                    return
                self._sending_s = time.monotonic()
                self._receiver.send(event, to_json(event, self._robot))
                journal.set_mark(name, event.sequence)
                self.counters[self._sent] += 1

    def _close_journal(self) -> None:
        if self._journal:
            self._journal.close()
        self._journal = None

    def _waiting(self, reason: str) -> str:
        return f"{self._receiver.name} does not take events ({reason}); they wait in the journal"
