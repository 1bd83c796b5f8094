"""All roles may query the time, only the router may serve it."""

import threading
import time
from pathlib import Path

import pytest

from common.transport.clock import CLOCK, serve_time
from common.transport.zenoh_bus import ZenohBus
from tests.security.guarded import WAIT_S, guarded

pytestmark = pytest.mark.network


def gets_reply(bus: ZenohBus, seconds: float) -> bool:
    """Query until a reply arrives; return False if none does."""
    replied = threading.Event()
    end_s = time.monotonic() + seconds
    while not replied.is_set() and time.monotonic() < end_s:
        bus.query(CLOCK, lambda _: replied.set())
        replied.wait(0.2)
    return replied.is_set()


@pytest.mark.parametrize("passwords", [False, True])
def test_planner_may_query_but_not_serve_the_time(tmp_path: Path, passwords: bool) -> None:
    with guarded(tmp_path, passwords) as network:
        planner = network.bus("planner")
        serve_time(network.bus("operator"), "liar")
        assert not gets_reply(planner, 0.8)
        serve_time(network.bus("router"), "router")
        assert gets_reply(planner, WAIT_S)
