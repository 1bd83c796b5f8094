"""Fixtures of several folders of tests."""

import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import SHARED
from tests.network import Network

RERUNS = 2


@pytest.fixture(autouse=True)
def thread_hook() -> Iterator[None]:
    """Undo what a test sets for threads that fail: a process ends then, here the tests' own."""
    before = threading.excepthook
    yield
    threading.excepthook = before


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of reference inputs beside the repository; skips where it is absent."""
    if not (SHARED / "data").is_dir():
        pytest.skip("reference data (../shared) is not beside the repository")
    return SHARED


@pytest.fixture(scope="module")
def network() -> Iterator[Network]:
    """Router on the loopback interface, and the sessions opened through it."""
    network = Network()
    yield network
    network.close()


@pytest.fixture
def state_folder() -> Iterator[Path]:
    """Folder for the state of a system; its path is short, since a socket's path is limited."""
    with tempfile.TemporaryDirectory(prefix="p4d") as folder:
        yield Path(folder)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let one worker run all tests that start processes: they share the processors.

    These and those that open sessions depend on other processes, which a busy machine may stop for
    seconds: what fails is repeated, and the summary says so.
    """
    for item in items:
        if item.get_closest_marker("processes"):
            item.add_marker(pytest.mark.xdist_group("processes"))
        if item.get_closest_marker("processes") or item.get_closest_marker("network"):
            item.add_marker(pytest.mark.flaky(reruns=RERUNS, reruns_delay=1))
