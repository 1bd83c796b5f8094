"""Flags of every service, and its behaviour after loading."""

import gc
import os
import subprocess
import sys

import pytest

from common.runtime import process
from people4d.messages.base import NAME


def test_process_without_a_name_gets_one_that_is_unique_on_every_host() -> None:
    # Process numbers in containers are equal: two detectors named detector-7 would be one.
    name = process._instance("detector", "host_1.local")
    assert NAME.fullmatch(name)
    assert name == f"detector-host-1.local-{os.getpid()}"


def test_what_was_loaded_is_not_searched_by_the_garbage_collector_again() -> None:
    loaded = [[k] for k in range(1000)]
    try:
        process.release_memory()
        assert not {id(one) for one in gc.get_objects()} & set(map(id, loaded))
    finally:
        gc.unfreeze()


FAILING_THREAD = """
import threading
from common.runtime import process
from common.runtime.threads import THREADS

def fail():
    {error}

process.prepare("detector-1", debug=False)
stopped = threading.Event()
process.on_stop_signals(stopped.set)
threading.Thread(target=fail, name="reader").start()
while not stopped.wait(0.1):
    pass
raise SystemExit(THREADS.exit_code)
"""


@pytest.mark.parametrize("error", ["raise ValueError('odd bytes')", "raise SystemExit(3)"])
@pytest.mark.processes
def test_process_whose_thread_fails_logs_it_and_exits_with_1(error: str) -> None:
    command = [sys.executable, "-c", FAILING_THREAD.format(error=error)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert "detector-1 CRITICAL thread reader failed, so the process ends" in done.stderr
    assert error.partition("raise ")[2].partition("(")[0] in done.stderr


@pytest.mark.processes
def test_process_that_cannot_stop_without_its_failed_thread_ends() -> None:
    text = FAILING_THREAD.format(error="raise ValueError").replace("stopped.set", "lambda: None")
    command = [sys.executable, "-c", text]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
