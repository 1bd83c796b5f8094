"""Rerun's viewer as a process, reached from this machine only, that contacts no other."""

import os
import socket
import subprocess
import time
from pathlib import Path

import rerun_cli

PORT = 9876  # where Rerun's own programs look first
START_S = 20.0
OPTIONS = ("--bind=127.0.0.1", "--expect-data-soon")  # by default it listens on all interfaces
# In CI Rerun sends no usage data. Its search for a newer version has no setting: the proxy is a
# port of this machine at which nothing listens.
SILENT = {"RERUN_APP_ONLY": "true", "CI": "1", "ALL_PROXY": "http://127.0.0.1:9"}


def start_viewer(port: int, headless: bool = False) -> "subprocess.Popen[bytes] | None":
    """Start the viewer and wait until it listens; it outlives this process.

    Args:
        port: Its port; if something listens there, nothing is started.
        headless: Without a window.

    Raises:
        RuntimeError: It does not listen.
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
    """Check that something of this machine listens at a port."""
    try:
        socket.create_connection(("127.0.0.1", port), 1.0).close()
    except OSError:
        return False
    return True
