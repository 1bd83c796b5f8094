"""Threads that fail: the process ends, so that it is started again, in place of working in part."""

import logging
import os
import signal
import threading

GRACE_S = 5.0  # from the failure to the end of a process that cannot stop in order without it

log = logging.getLogger("people4d")


class ThreadFailures:
    """Failures of the threads of this process."""

    def __init__(self) -> None:
        self._failed = False

    def watch(self) -> None:
        """From now on, end this process once a thread fails, as a stop signal would."""
        threading.excepthook = self._end

    @property
    def exit_code(self) -> int:
        """Exit code of a process that stops: 1 if a thread failed, which has it restarted."""
        return int(self._failed)

    def _end(self, failure: threading.ExceptHookArgs) -> None:
        name = failure.thread.name if failure.thread else "of a library"
        error = failure.exc_value or failure.exc_type()
        log.critical("thread %s failed, so the process ends", name, exc_info=error)
        self._failed = True
        end = threading.Timer(GRACE_S, os._exit, (1,))
        end.daemon = True
        end.start()
        os.kill(os.getpid(), signal.SIGTERM)


THREADS = ThreadFailures()  # of this process
