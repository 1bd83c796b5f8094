"""Slow links: the router lets fewer messages through."""

import queue
import time

import pytest
import zenoh

from common.transport.access import downsampling
from common.transport.ports import free_port
from common.transport.zenoh_bus import ZenohBus, read_config
from people4d.errors import ConfigError
from tests.network import WAIT_S

pytestmark = pytest.mark.network

TRACKS, HEALTH = "people4d/v1/robot/people", "people4d/v1/robot/health/a/b"


def test_tracks_pass_a_slow_link_at_its_rate() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    slow = {"PEOPLE4D_LISTEN": endpoint, "PEOPLE4D_SLOW_LINKS": "lo", "PEOPLE4D_SLOW_HZ": "5"}
    router = ZenohBus(read_config(None, "router", slow), "robot")
    client = read_config(None, "client", {"PEOPLE4D_CONNECT": endpoint})
    received: queue.Queue[str] = queue.Queue()
    try:
        with zenoh.open(client) as publisher, zenoh.open(client) as listener:
            _subscriber = listener.declare_subscriber(
                "people4d/**", lambda sample: received.put(str(sample.key_expr))
            )
            wait_until_linked(publisher, received)
            begin_s = time.monotonic()
            for _ in range(100):  # of these at most one in 200 ms, of health each
                publisher.put(TRACKS, b"people", congestion_control=zenoh.CongestionControl.BLOCK)
                publisher.put(HEALTH, b"health", congestion_control=zenoh.CongestionControl.BLOCK)
            lasted_s = time.monotonic() - begin_s
            found = [received.get(timeout=WAIT_S)]
            while found.count(HEALTH) < 100:
                found.append(received.get(timeout=WAIT_S))
    finally:
        router.close()
    assert 1 <= found.count(TRACKS) <= lasted_s / 0.2 + 2


def wait_until_linked(publisher: zenoh.Session, received: "queue.Queue[str]") -> None:
    """Publish until the listener receives it, then drop what it received."""
    end_s = time.monotonic() + WAIT_S
    while time.monotonic() < end_s:
        publisher.put("people4d/v1/robot/transforms/x", b"")
        try:
            received.get(timeout=0.1)
        except queue.Empty:
            continue
        while not received.empty():
            received.get()
        return
    raise TimeoutError("the listener receives nothing")


def test_topics_with_one_key_are_slowed_down() -> None:
    (rules,) = downsampling(["wlan0"], 10.0)
    assert rules["interfaces"] == ["wlan0"]
    keys = {rule["key_expr"].rpartition("/")[2]: rule["freq"] for rule in rules["rules"]}
    names = ("odometry", "people", "gait", "skeletons", "truth", "score")
    assert keys == dict.fromkeys(names, 10.0)
    assert downsampling(["wlan0"], 100.0) == []  # nothing comes more often


def test_rate_that_is_no_number_is_an_error() -> None:
    with pytest.raises(ConfigError, match="PEOPLE4D_SLOW_HZ: expected a number, got 'fast'"):
        read_config(None, "router", {"PEOPLE4D_SLOW_LINKS": "lo", "PEOPLE4D_SLOW_HZ": "fast"})
