"""Rows of the threat model (SECURITY.md) that no other test shows."""

import json
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
import zenoh

from common.transport.zenoh_bus import read_config
from people4d.messages import Health
from people4d.topics import BY_MESSAGE
from tests.contract.examples import BY_NAME as EXAMPLES
from tests.network import Network
from tests.security.guarded import PREFIX, Guarded, Listener, guarded, settle

pytestmark = pytest.mark.network


@pytest.fixture
def keyed(tmp_path: Path) -> Iterator[Guarded]:
    with guarded(tmp_path) as network:
        yield network


@pytest.mark.parametrize("mode", ["router", "peer"])
def test_without_keys_processes_listen_on_this_machine_only(mode: str) -> None:
    config = read_config(None, mode, {})
    (endpoint,) = json.loads(config.get_json("listen/endpoints"))
    assert endpoint.startswith("tcp/127.0.0.1:")
    assert config.get_json("scouting/multicast/enabled") == "false"


def test_without_keys_everybody_who_connects_may_publish_people(network: Network) -> None:
    """The documentation states this fact, so such a system is not mistaken for a safe one."""
    config = read_config(None, "client", network.environment)
    with zenoh.open(config) as planner, zenoh.open(config) as stranger:
        listener = Listener(planner, f"{PREFIX}/people")
        settle(planner)
        stranger.put(f"{PREFIX}/people", b"invented")
        listener.wait(b"invented")


def test_service_cannot_send_the_health_of_another_service(keyed: Guarded) -> None:
    """Else it could have the watchdog restart it."""
    health = msgspec.structs.replace(EXAMPLES["Health"], service="tracker", instance="tracker-1")
    assert isinstance(health, Health)
    key = BY_MESSAGE[Health].key_of(health, "robot")
    operator, detector = keyed.session("operator"), keyed.session("detector")
    listener = Listener(operator, f"{PREFIX}/health/*/*")
    settle(operator)
    detector.put(key, b"false")
    settle(detector)
    keyed.session("tracker").put(key, b"true")
    listener.wait(b"true")
    assert listener.received == [b"true"]


def test_service_may_invent_what_it_produces(keyed: Guarded) -> None:
    """A fact that the documentation states: within a role there are no checks."""
    tracker, detector = keyed.session("tracker"), keyed.session("detector")
    listener = Listener(tracker, f"{PREFIX}/detections/*")
    settle(tracker)
    detector.put(f"{PREFIX}/detections/front", b"invented")
    listener.wait(b"invented")
