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

PEOPLE, HEALTH = "people4d/v1/robot/people", "people4d/v1/robot/health/a/b"


def test_people_pass_a_slow_link_at_the_rate_that_it_carries() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    slow = {"PEOPLE4D_LISTEN": endpoint, "PEOPLE4D_SLOW_LINKS": "lo", "PEOPLE4D_SLOW_HZ": "5"}
    router = ZenohBus(read_config(None, "router", slow), "robot")
    client = read_config(None, "client", {"PEOPLE4D_CONNECT": endpoint})
    heard: queue.Queue[str] = queue.Queue()
    try:
        with zenoh.open(client) as speaker, zenoh.open(client) as listener:
            _subscriber = listener.declare_subscriber(
                "people4d/**", lambda sample: heard.put(str(sample.key_expr))
            )
            until_heard(speaker, heard)
            begin_s = time.monotonic()
            for _ in range(100):  # of these at most one in 200 ms, of health each
                speaker.put(PEOPLE, b"people", congestion_control=zenoh.CongestionControl.BLOCK)
                speaker.put(HEALTH, b"health", congestion_control=zenoh.CongestionControl.BLOCK)
            lasted_s = time.monotonic() - begin_s
            found = [heard.get(timeout=WAIT_S)]
            while found.count(HEALTH) < 100:
                found.append(heard.get(timeout=WAIT_S))
    finally:
        router.close()
    assert 1 <= found.count(PEOPLE) <= lasted_s / 0.2 + 2


def until_heard(speaker: zenoh.Session, heard: "queue.Queue[str]") -> None:
    """Speak until it is heard, then forget that."""
    end_s = time.monotonic() + WAIT_S
    while time.monotonic() < end_s:
        speaker.put("people4d/v1/robot/transforms/x", b"")
        try:
            heard.get(timeout=0.1)
        except queue.Empty:
            continue
        while not heard.empty():
            heard.get()
        return
    raise TimeoutError("the listener hears nothing")


def test_topics_with_one_key_are_slowed_down() -> None:
    (rules,) = downsampling(["wlan0"], 10.0)
    assert rules["interfaces"] == ["wlan0"]
    keys = {rule["key_expr"].rpartition("/")[2]: rule["freq"] for rule in rules["rules"]}
    names = ("odometry", "people", "gait", "truth", "score")
    assert keys == dict.fromkeys(names, 10.0)
    assert downsampling(["wlan0"], 100.0) == []  # nothing comes more often


def test_a_rate_that_is_none_is_told() -> None:
    with pytest.raises(ConfigError, match="PEOPLE4D_SLOW_HZ: expected a number, got 'fast'"):
        read_config(None, "router", {"PEOPLE4D_SLOW_LINKS": "lo", "PEOPLE4D_SLOW_HZ": "fast"})
