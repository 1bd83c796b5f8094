"""Exceptions of a process: one log entry for each kind, and a reason for its heartbeat."""

import logging
import math
import threading
import time
from collections import Counter
from pathlib import Path
from traceback import extract_tb

FRESH_S = 5.0  # time for which an exception degrades the process [s]
KINDS_MAX = 256  # maximum number of kinds that are counted separately
TEXT_MAX = 200  # maximum length of the text of an exception [characters]

log = logging.getLogger("people4d")


class ErrorLog:
    """Exceptions by their kind: type, file and line.

    The first exception of a kind is logged with its traceback, the 10th, 100th, ... in one line: an
    exception in every message neither hides the log nor fills the disk. Thread-safe.
    """

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._last = ""
        self._last_s = -math.inf
        self._lock = threading.Lock()

    def add_error(self, error: Exception, what: str) -> None:
        """Count a caught exception."""
        kind = f"{type(error).__name__} in {_source_line(error)}"
        text = f"{what} ({kind}): {str(error)[:TEXT_MAX]}"
        with self._lock:
            if kind not in self._counts and len(self._counts) >= KINDS_MAX:
                kind = "other errors"
            self._counts[kind] += 1
            count = self._counts[kind]
            self._last, self._last_s = f"{text}, {count} in all", time.monotonic()
        if count == 1:
            log.error("%s", text, exc_info=error)
        elif math.log10(count).is_integer():
            log.error("%s: %d times by now", text, count)

    def reason(self) -> str:
        """Return the last exception and its count, one sentence; empty if it is too old."""
        with self._lock:
            return self._last if time.monotonic() - self._last_s < FRESH_S else ""


def _source_line(error: Exception) -> str:
    """Return file and line in which an exception was raised."""
    frames = extract_tb(error.__traceback__)
    return f"{Path(frames[-1].filename).name} line {frames[-1].lineno}" if frames else "no line"
