"""Threads that take turns at a node's heavy part, so that none takes work long before it is due."""

import threading


class Gate:
    """Whoever passes holds the gate until they open it; others wait before they take a message.

    Of two threads the second would take a frame while the first still runs the network, and hold
    it until that is done: an old one by then. Behind the gate the frame waits in the inbox, where
    a newer one takes its place.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._holder: int | None = None

    def enter(self, timeout_s: float) -> bool:
        """Wait for the gate and hold it; return whether it became free in time."""
        if not self._lock.acquire(timeout=timeout_s):
            return False
        self._holder = threading.get_ident()
        return True

    def open(self) -> None:
        """Let the next one pass; does nothing if this thread does not hold the gate."""
        if self._holder == threading.get_ident():
            self._holder = None
            self._lock.release()
