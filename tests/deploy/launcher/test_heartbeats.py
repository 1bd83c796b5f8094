"""Heartbeats of processes of the same name on several hosts."""

import socket

from deploy.launcher.health import of_instance
from people4d.messages import Health
from tests.contract.examples import FULL

EXAMPLE = next(message for message in FULL if isinstance(message, Health))


def health(instance: str, host: str, pid: int) -> Health:
    fields = {name: getattr(EXAMPLE, name) for name in EXAMPLE.__struct_fields__}
    return Health(**{**fields, "instance": instance, "host": host, "pid": pid})


def test_heartbeat_is_matched_by_host() -> None:
    here = health("watchdog-1", socket.gethostname(), 7)
    there = health("watchdog-1", "another machine", 7)
    for order in ([here, there], [there, here]):
        assert of_instance(order, "watchdog-1") is here
        assert of_instance(order, "watchdog-1", pid=7) is here


def test_a_container_has_another_name_than_its_machine() -> None:
    contained = health("tracker-1", "1f2e3d4c5b6a", 1)
    assert of_instance([contained, health("reid-1", "x", 1)], "tracker-1") is contained


def test_another_process_of_the_name_does_not_count() -> None:
    ended = health("tracker-1", socket.gethostname(), 8)
    assert of_instance([ended], "tracker-1", pid=9) is None
    assert of_instance([], "tracker-1") is None
