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
# Tests that depend on the scheduler of the kernel, which may stop a process of a busy host for
# seconds. Only these tests are repeated. The reason names what they measure or wait for.
SCHEDULED = {
    "tests/attacks/": "pauses of people during an attack",
    "tests/common/ros2/": "discovery between processes by DDS and rmw_zenoh",
    "tests/common/runtime/test_process.py": "the end of a process after a signal",
    "tests/dashboard/browser/": "drawings of Chromium beside a running system",
    "tests/deploy/cli/test_health.py": "a router that starts later than a command",
    "tests/deploy/launcher/": "starts, ends and restarts by supervisord",
    "tests/events/test_process.py": "deliveries of a process that is killed",
    "tests/gt_bridge/sources/test_live.py": "discovery between processes by rmw_zenoh",
    "tests/integration/": "processes that are stopped, killed and replaced",
    "tests/people4d/test_install.py": "the start of a system beside the build of wheels",
    "tests/security/test_outward.py": "a demo under observation of its system calls",
    "tests/security/test_privacy.py": "links between network namespaces",
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
    """Give each file to one worker, slower files first, and repeat tests of `SCHEDULED`.

    Fixtures of a module start once then, not once in each worker.
    """
    slower = {item.path for item in items if any(map(item.get_closest_marker, SLOWER))}
    items.sort(key=lambda item: item.path not in slower)
    for item in items:
        if not item.get_closest_marker("xdist_group"):
            item.add_marker(pytest.mark.xdist_group(item.location[0]))
        if item.nodeid.startswith(tuple(SCHEDULED)):
            item.add_marker(pytest.mark.flaky(reruns=RERUNS, reruns_delay=1))


def pytest_make_parametrize_id(val: object, argname: str) -> str | None:
    """Name long values by their argument: every worker holds and sends the names of all tests."""
    return argname if isinstance(val, str | bytes) and len(val) > NAME_MAX else None
