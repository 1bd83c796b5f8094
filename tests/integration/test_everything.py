"""A system with all services: its sockets, its people in ROS 2, and its page in a browser."""

import ipaddress
import os
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import psutil
import pytest
from playwright.sync_api import expect
from zenoh_ros2_sdk import ROS2Subscriber, discovery

from common.ros2.messages.people import PEOPLE
from deploy.cli.live.page import page_address
from deploy.launcher.state import State
from people4d.client import Client
from people4d.messages import Health
from tests import DEMO, ROOT
from tests.common.ros2.foreign import Received, Sdk, until
from tests.dashboard.browser.chromium import WAIT_S, chromium, shows_image
from tests.dashboard.browser.chromium import until as until_shown
from tests.integration.system import ROBOT, System, running

pytestmark = [pytest.mark.processes, pytest.mark.network, pytest.mark.timeout(300)]

STANDING = "tests.attacks.standing:StandingPeople"
PAGE = ROOT / "docs" / "operation" / "security.md"
ROW = re.compile(r"^\| ([\w -]+) \| (\d+) \|", re.MULTILINE)
EVERYTHING = (
    "--dashboard",
    "--ros2",
    "zenoh",
    "--predict",
    "--skeletons",
    "--target",
    "--gait",
    "--events",
)
SERVERS = {
    "export --prometheus": ("export", "--prometheus", "0"),
    "view --foxglove": ("view", "--foxglove", "--port", "0"),
}


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    """Folder for the state, with a short path."""
    with tempfile.TemporaryDirectory(prefix="p4d") as folder:
        yield Path(folder)


@pytest.fixture(scope="module")
def system(folder: Path) -> Iterator[System]:
    options = ("--truth", str(DEMO), "--set", "dashboard.port=0", "--set", "camera.stride=2")
    with running(folder, *EVERYTHING, *options, source=STANDING) as system:
        yield system


def documented(process: str) -> int:
    """Return the number of sockets of a process in the documentation's table."""
    section = PAGE.read_text().split("## Listening sockets")[1].split("\n## ")[0]
    counts = {name: int(count) for name, count in ROW.findall(section)}
    return counts.get(process, counts["every other service"])


def listening(pids: Iterable[int]) -> list[tuple[str, int]]:
    """Return addresses and ports at which processes take connections or datagrams."""
    return [
        (connection.laddr.ip, connection.laddr.port)
        for pid in pids
        for connection in psutil.Process(pid).net_connections("inet")
        if connection.status in (psutil.CONN_LISTEN, psutil.CONN_NONE)
    ]


@contextmanager
def server(connect: str, *arguments: str) -> Iterator[int]:
    """Run a command that serves until the block ends; return its process number."""
    command = [sys.executable, "-m", "deploy.cli", *arguments, "--robot", ROBOT]
    process = subprocess.Popen(
        [*command, "--connect", connect],
        env=os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout
        assert process.stdout.readline()  # where it serves
        yield process.pid
    finally:
        process.kill()
        process.communicate()


def test_listening_sockets_are_those_of_the_documentation_on_loopback(system: System) -> None:
    pids = system.pids()
    supervisor = psutil.Process(pids["router-1"]).ppid()
    found = {name.rpartition("-")[0]: listening([pid]) for name, pid in pids.items()}
    found["supervisord"] = listening([supervisor])
    for name, arguments in SERVERS.items():
        with server(system.connect, *arguments) as pid:
            found[name] = listening([pid])
    counts = Counter({name: len(sockets) for name, sockets in found.items()})
    assert counts == {name: documented(name) for name in found}
    assert {"router", "camera", "detector", "gt_bridge", "dashboard", "ros2_bridge"} < found.keys()
    beyond = {
        name: [address for address, _ in sockets if not ipaddress.ip_address(address).is_loopback]
        for name, sockets in found.items()
    }
    assert not any(beyond.values()), beyond


def test_people_reach_a_client_of_ros(system: System, tmp_path: Path) -> None:
    with closing(Sdk(system.connect, tmp_path)) as sdk:
        heard = Received()

        def note(message: object) -> None:
            if message.people:  # type: ignore[attr-defined]
                heard(message)

        subscriber = ROS2Subscriber("/people", PEOPLE, note, sdk.learn(PEOPLE), **sdk.where)
        person = heard.wait().people[0]
        assert int(person.tags[0]) == int(person.name)
        topics = {"/people", "/people4d/markers"}
        until(lambda: topics <= dict(discovery.get_topic_names_and_types(**sdk.where)).keys())
        with Client(system.connect, ROBOT) as client:
            healths = client.messages(Health, timeout_s=30)
            bridge = next(health for health in healths if health.service == "ros2_bridge")
        assert bridge.counters["ros2_sent"] > 0
        assert bridge.counters["send_errors"] == 0
        subscriber.close()


def test_page_shows_the_people(system: System, folder: Path) -> None:
    address = page_address(State(folder / ROBOT))
    assert address is not None
    with chromium() as browser:
        expect.set_options(timeout=WAIT_S * 1000)
        page = browser.new_page()
        page.set_default_timeout(WAIT_S * 1000)
        page.goto(address.login)
        people = page.locator("#table tbody tr")
        people.first.wait_for()
        until_shown(lambda: shows_image(page), page)
        expect(page.locator("#processes")).to_contain_text("tracker-1")
        people.first.get_by_role("button").click()
        expect(page.locator("tr.chosen")).to_have_count(1)
