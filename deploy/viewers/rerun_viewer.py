"""Process of Rerun's viewer, on the loopback interface and without outward connections."""

import os
import socket
import subprocess
import time
from pathlib import Path

import rerun_cli

PORT = 9876  # default port of Rerun
START_S = 20.0  # maximum duration of the start [s]
OPTIONS = ("--bind=127.0.0.1", "--expect-data-soon")  # the default is all interfaces
# CI disables Rerun's usage data. Its search for newer versions has no setting, so the proxy is a
# local port without a listener.
SILENT = {"RERUN_APP_ONLY": "true", "CI": "1", "ALL_PROXY": "http://127.0.0.1:9"}


def start_viewer(port: int, headless: bool = False) -> "subprocess.Popen[bytes] | None":
    """Start the viewer, which outlives this process, and wait until it listens.

    RuntimeError if the viewer does not listen.

    Args:
        port: Port of the viewer; a running viewer is used.
        headless: Start without a window.
    """
    if _listens(port):
        return None
    command = [str(Path(rerun_cli.__file__).with_name("rerun")), f"--port={port}", *OPTIONS]
    process = subprocess.Popen(
        [*command, "--headless"] if headless else command,
        env=os.environ | SILENT,
        start_new_session=True,
    )
    until_s = time.monotonic() + START_S
    while not _listens(port):
        if process.poll() is not None or time.monotonic() > until_s:
            raise RuntimeError(f"it does not listen at port {port}")
        time.sleep(0.05)
    return process


def _listens(port: int) -> bool:
    """Check that a local process listens at a port."""
    try:
        socket.create_connection(("127.0.0.1", port), 1.0).close()
    except OSError:
        return False
    return True
