"""Failed threads: the process ends and is restarted, since partial work is unsafe."""

import logging
import os
import signal
import threading

GRACE_S = 5.0  # maximum time from the failure to the end of the process [s]

log = logging.getLogger("people4d")


class ThreadFailures:
    """Failures of the threads of this process."""

    def __init__(self) -> None:
        self._failed = False

    def watch(self) -> None:
        """End this process as by a stop signal once a thread fails."""
        threading.excepthook = self._end

    @property
    def exit_code(self) -> int:
        """Exit code of the process: 1 after a failed thread, so that it is restarted."""
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


THREADS = ThreadFailures()  # failures in this process
