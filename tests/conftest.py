"""Fixtures of several folders of tests."""

import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import SHARED
from tests.network import Network

RERUNS = 2
NAME_MAX = 100  # maximum length of a value in the name of a test
SLOWER = ("processes", "network", "render", "slow")  # markers of tests that run first
HUNG = "a process that the kernel stops for 2.25 s counts as hung"
REPLACED = "a replica that the kernel stops for 1.2 s loses its frames to others"
MISSED = "a recorder that the kernel stops for the time of a frame misses it"
PAUSED = "a pause of the host of seconds ends tracks as an attack would"
# Files whose failed tests are repeated, since a busy host decides about their result, and why
SCHEDULED = {
    "tests/integration/test_faults.py": HUNG,
    "tests/integration/test_tracker_restart.py": HUNG,
    "tests/deploy/launcher/test_launcher.py": HUNG,
    "tests/deploy/launcher/test_alone.py": MISSED,
    "tests/deploy/launcher/test_scale.py": REPLACED,
    "tests/integration/test_replicas.py": REPLACED,
    "tests/common/runtime/test_replicas.py": REPLACED,
    "tests/attacks/test_attacks.py": PAUSED,
}


@pytest.fixture(autouse=True)
def thread_hook() -> Iterator[None]:
    """Undo the hook for threads that fail: it ends the process, here the tests' own."""
    before = threading.excepthook
    yield
    threading.excepthook = before


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of reference inputs next to the repository; skips if it is absent."""
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


@pytest.hookimpl(tryfirst=True)  # xdist reads the groups in the same hook
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give each file to one worker, slower files first, and repeat failed tests of `SCHEDULED`.

    Fixtures of a module start once then, not once in each worker.
    """
    slower = {item.path for item in items if any(map(item.get_closest_marker, SLOWER))}
    items.sort(key=lambda item: item.path not in slower)
    for item in items:
        if not item.get_closest_marker("xdist_group"):
            item.add_marker(pytest.mark.xdist_group(item.location[0]))
        if item.location[0] in SCHEDULED:
            item.add_marker(pytest.mark.flaky(reruns=RERUNS, reruns_delay=1))


def pytest_make_parametrize_id(val: object, argname: str) -> str | None:
    """Name long values by their argument: every worker holds and sends the names of all tests."""
    return argname if isinstance(val, str | bytes) and len(val) > NAME_MAX else None
