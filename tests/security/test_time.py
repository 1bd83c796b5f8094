"""Everybody may ask the time, only the router tells it."""

import threading
import time
from pathlib import Path

import pytest

from common.transport.clock import NAME, keep_time
from common.transport.zenoh_bus import ZenohBus
from tests.security.guarded import WAIT_S, guarded


def is_told(bus: ZenohBus, seconds: float) -> bool:
    """Ask until somebody answers; return whether somebody did."""
    told = threading.Event()
    end_s = time.monotonic() + seconds
    while not told.is_set() and time.monotonic() < end_s:
        bus.ask(NAME, lambda _: told.set())
        told.wait(0.2)
    return told.is_set()


@pytest.mark.parametrize("passwords", [False, True])
def test_a_planner_may_ask_but_not_tell_the_time(tmp_path: Path, passwords: bool) -> None:
    with guarded(tmp_path, passwords) as network:
        planner = network.bus("planner")
        keep_time(network.bus("operator"), "liar")
        assert not is_told(planner, 1.5)
        keep_time(network.bus("router"), "router")
        assert is_told(planner, WAIT_S)
