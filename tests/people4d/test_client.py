"""Client and subscription through a router."""

import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

import people4d
from common.transport.ports import free_port
from people4d.client import Client, subscribe
from people4d.errors import ConfigError, People4dError
from people4d.messages import Event, Health, Message, Tracks, Truth
from people4d.session import endpoints_of, problem_of
from people4d.topics import TOPICS
from tests import ROOT
from tests.contract.examples import BY_NAME
from tests.network import WAIT_S, Network

pytestmark = pytest.mark.network


@pytest.fixture
def publishing(network: Network) -> Iterator[str]:
    """Name of a robot that publishes tracks and health repeatedly."""
    robot, stop = network.robot(), threading.Event()
    bus = network.open(robot)

    def publish() -> None:
        while not stop.wait(0.02):
            bus.publish(BY_NAME["Tracks"])
            bus.publish(BY_NAME["Health"])

    thread = threading.Thread(target=publish)
    thread.start()
    yield robot
    stop.set()
    thread.join()


def test_subscribe_yields_tracks(network: Network, publishing: str) -> None:
    for people in subscribe(network.endpoint, publishing):
        assert isinstance(people, Tracks)
        assert [person.id for person in people.tracks] == [7]
        break


def test_several_types_are_received_together(network: Network, publishing: str) -> None:
    with Client(network.endpoint, publishing) as client:
        received: set[type[Message]] = set()
        for message in client.messages(Tracks, Health, timeout_s=10.0):
            received.add(type(message))
            if len(received) == 2:
                break
        assert received == {Tracks, Health}
        assert client.counters["received_people"] >= 1


def test_the_iteration_ends_when_nothing_comes(network: Network, publishing: str) -> None:
    with Client(network.endpoint, publishing) as client:
        assert list(client.messages(Truth, timeout_s=0.1)) == []


def test_messages_between_the_call_and_the_loop_are_not_lost(network: Network) -> None:
    # The subscription must exist before the loop begins.
    robot = network.robot()
    bus = network.open(robot)
    with Client(network.endpoint, robot) as client:
        messages = client.messages(Truth, timeout_s=10.0)
        for _ in range(20):  # the subscription takes a moment to reach the publisher
            bus.publish(BY_NAME["Truth"])
            time.sleep(0.05)
        assert isinstance(next(messages), Truth)


@pytest.mark.parametrize(
    ("services", "found"),
    [((), "no service runs"), (("camera", "detector"), "these services run: camera, detector")],
)
def test_silence_is_logged_once_with_the_services_found(
    caplog: pytest.LogCaptureFixture, services: tuple[str, ...], found: str
) -> None:
    network = Network()  # a robot of this test: other tests announce robots
    try:
        for service in services:
            network.open("mine").announce(service, f"{service}-1")
        with Client(network.endpoint, "mine", warn_after_s=0.1) as client:
            assert list(client.arrivals(Tracks, timeout_s=0.8)) == []
        assert [record.name for record in caplog.records] == ["people4d"]
        assert found in caplog.text
    finally:
        network.close()


def test_iteration_in_another_thread_ends_when_the_client_is_closed(network: Network) -> None:
    client = Client(network.endpoint, network.robot(), warn_after_s=0.0)
    thread = threading.Thread(target=list, args=(client.arrivals(Tracks),))
    thread.start()
    client.close()
    thread.join(WAIT_S)
    assert not thread.is_alive()
    assert client.session.present() == []


def test_another_robot_is_named_in_the_log(
    network: Network, caplog: pytest.LogCaptureFixture
) -> None:
    network.open("mine").announce("tracker", "tracker-1")
    with Client(network.endpoint, "yours", warn_after_s=0.1) as client:
        list(client.arrivals(Tracks, timeout_s=0.5))
    assert re.search("no robot 'yours' is there, but .*'mine'.*; add --robot", caplog.text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("127.0.0.1:7650", ["tcp/127.0.0.1:7650"]),
        ("[::1]:7447, tls/nuc:7447", ["tcp/[::1]:7447", "tls/nuc:7447"]),
        ("nuc.local:7447", ["tcp/nuc.local:7447"]),
    ],
)
def test_endpoint_without_a_protocol_is_tcp(text: str, expected: list[str]) -> None:
    assert endpoints_of(text) == expected


@pytest.mark.parametrize("text", ["nuc", "tcp/", "/nuc:7447"])
def test_endpoint_that_is_none_is_rejected(text: str) -> None:
    with pytest.raises(ConfigError, match="is not an endpoint"):
        endpoints_of(text)


def test_all_messages_that_a_planner_reads_or_sends_are_public() -> None:
    planners = {
        topic.message.__name__
        for topic in TOPICS
        if "planner" in topic.producers or {"planner", "*"} & set(topic.readers.split())
    }
    assert {"Event", "TargetCommand", "Tracks"} < planners
    assert planners | {"Client", "subscribe"} <= set(people4d.__all__) <= set(dir(people4d))
    assert people4d.Event is Event


@pytest.mark.processes
def test_importing_the_contract_loads_neither_zenoh_nor_the_pipeline() -> None:
    light = (
        "import sys, people4d, people4d.codec; from people4d import Track, Tracks;"
        "print([m for m in ('zenoh', 'cv2', 'common', 'services') if m in sys.modules])"
    )
    client = "from people4d import Client, subscribe; import sys; print('common' in sys.modules)"
    for program, expected in ((light, "[]\n"), (client, "False\n")):
        done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True)
        assert (done.stdout.decode(), done.stderr) == (expected, b"")


def test_absent_router_is_reported_with_its_endpoint(monkeypatch: pytest.MonkeyPatch) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with pytest.raises(People4dError, match="Is the system up"):
        Client(endpoint, timeout_s=0.3)
    monkeypatch.setenv("PEOPLE4D_CONNECT", endpoint)
    with pytest.raises(People4dError, match=endpoint):
        Client(timeout_s=0.3)


def test_an_endpoint_does_not_hide_the_file_with_the_credentials(
    network: Network, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    # $PEOPLE4D_ZENOH must count, too, if an endpoint is given.
    monkeypatch.setenv("PEOPLE4D_ZENOH", str(tmp_path / "absent.json5"))
    with pytest.raises(ConfigError, match=r"absent\.json5"):
        Client(network.endpoint)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_thread_that_fails_to_receive_ends_the_iteration_with_an_error(
    network: Network, monkeypatch: pytest.MonkeyPatch, publishing: str
) -> None:
    def fail(*_: object) -> None:
        raise MemoryError("no room for a message")

    monkeypatch.setattr("people4d.queue.MessageQueue.add_payload", fail)
    with (
        Client(network.endpoint, publishing) as client,
        pytest.raises(People4dError, match="no room for a message"),
    ):
        next(client.messages(Tracks))
    for thread in threading.enumerate():
        if thread.name == "people":  # it ends after it printed its error
            thread.join(WAIT_S)


@pytest.mark.parametrize(
    ("error", "text"),
    [
        ("no key at /home/user/.cargo/src/io/tls.rs:41.", "no key"),
        ("no key at io/zenoh-links/src/tls.rs:41:7.", "no key"),
        (
            "Unable to connect to any of [tcp/a:1]. Timeout! at x.rs:9.",
            "it does not answer",
        ),
    ],
)
def test_error_of_zenoh_names_no_file_of_its_sources(error: str, text: str) -> None:
    assert problem_of(zenoh.ZError(error)) == text


def test_absent_system_is_one_error_without_another_as_its_cause() -> None:
    with pytest.raises(People4dError, match="no Zenoh session") as caught:
        next(iter(subscribe("tcp/127.0.0.1:1")))
    assert caught.value.__suppress_context__


def test_planner_of_the_docs_reports_an_absent_system_in_one_line() -> None:
    command = [sys.executable, str(ROOT / "docs" / "examples" / "planner.py"), "tcp/127.0.0.1:1"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("no Zenoh session with")
    assert len(done.stderr.splitlines()) == 1
