"""Health of a process, as it is heard on the bus."""

import importlib.metadata
import threading
import time
from collections.abc import Iterator

import pytest

from common.runtime import heartbeat, throughput
from common.runtime.heartbeat import Activity, Heartbeat
from common.runtime.inbox import Inbox
from common.runtime.node import Status
from common.transport.clock import serve_time
from common.transport.trace import ProcessId
from common.transport.zenoh_bus import ZenohBus
from people4d.messages import Detections, Health
from people4d.topics import BY_NAME
from tests.common.nodes import Echo
from tests.network import WAIT_S, Network, Watcher

PROCESS_ID = ProcessId("detector", "detector-1", "robot")
NO_CLOCK = {"clock_steps": 0, "bad_clock": 0}


class Beating:
    """A node whose heart beats, and a watcher on the same session."""

    def __init__(self, bus: ZenohBus, node: Echo) -> None:
        self.bus, self.node, self.inbox, self.activity = bus, node, Inbox(), Activity()
        self.watcher = Watcher(bus, Health)
        self.heartbeat = Heartbeat(node, bus, PROCESS_ID, self.inbox, self.activity)

    def wait(self, state: str) -> Health:
        return self.watcher.wait(Health, lambda health: health.state == state)


@pytest.fixture
def beating(network: Network, monkeypatch: pytest.MonkeyPatch) -> Iterator[Beating]:
    monkeypatch.setattr(heartbeat, "PERIOD_S", 0.05)
    monkeypatch.setattr(heartbeat, "STALLED_AFTER_S", 0.2)
    beating = Beating(network.open(network.robot()), Echo())
    yield beating
    beating.heartbeat.close()


def test_a_heartbeat_tells_who_and_counts_up(beating: Beating) -> None:
    first, second = beating.wait("ready"), beating.wait("ready")
    assert (first.service, first.instance, first.host) == ("detector", "detector-1", "robot")
    assert second.sequence == first.sequence + 1
    assert second.stamp_ns > first.stamp_ns
    assert first.gauges["memory_mb"] > 1
    assert first.reason == ""


def test_the_state_of_the_node_is_told(beating: Beating) -> None:
    beating.node.state = "starting"
    beating.wait("starting")
    beating.node.state = "finished"
    beating.wait("stopping")


def test_a_reason_of_many_lines_is_told_in_one(beating: Beating) -> None:
    beating.node.reason = "the model failed:\n\x1b[31mno memory"
    beating.node.state = "degraded"
    assert beating.wait("degraded").reason == "the model failed:  [31mno memory"


def test_a_node_that_hangs_is_told_as_stalled_until_it_goes_on(beating: Beating) -> None:
    release = threading.Event()

    def hang() -> None:
        with beating.activity.busy():
            release.wait(WAIT_S)

    thread = threading.Thread(target=hang)
    thread.start()
    assert beating.wait("stalled").reason == "busy with one message for 0 s"
    release.set()
    beating.wait("ready")
    thread.join()


def test_a_thread_that_hangs_is_told_though_another_works(beating: Beating) -> None:
    release = threading.Event()

    def hang() -> None:
        with beating.activity.busy():
            release.wait(WAIT_S)

    thread = threading.Thread(target=hang)
    thread.start()
    for _ in range(10):
        with beating.activity.busy():
            beating.watcher.wait(Health)
    beating.wait("stalled")
    release.set()
    thread.join()


def test_bytes_that_do_not_decode_degrade_for_a_while(
    beating: Beating, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("people4d.queue.FRESH_S", 0.3)
    beating.inbox.put(BY_NAME["detections"], "k", b"\xc1")
    health = beating.wait("degraded")
    assert health.reason.startswith("message: expected MessagePack")
    assert health.counters["bad_detections"] == 1
    assert beating.wait("ready").counters["bad_detections"] == 1


def test_counters_of_node_inbox_and_loop_are_told_together(beating: Beating) -> None:
    beating.node.handled = [1, 2, 3]
    beating.activity.count("errors")
    beating.activity.count("errors")
    beating.inbox.put(BY_NAME["truth"], "k", b"")
    told = beating.watcher.wait_for_counters(handled=3, errors=2, bad_truth=1).counters
    # What never happened is told as 0: the reader sees that it is counted.
    assert told == {"handled": 3, "skipped": 0, "errors": 2, "bad_truth": 1} | NO_CLOCK


def test_the_age_of_what_was_taken_last_is_told_and_grows(beating: Beating) -> None:
    received_ns = time.time_ns() - 500_000_000
    beating.activity.note_taken("frames", received_ns)
    first = beating.watcher.wait(Health, lambda health: "age_frames_ms" in health.gauges)
    second = beating.watcher.wait(Health)
    assert 500 <= first.gauges["age_frames_ms"] < second.gauges["age_frames_ms"]


def test_the_clock_is_compared_with_that_of_the_router(
    network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(heartbeat, "PERIOD_S", 0.05)
    robot = network.robot()
    serve_time(network.open(robot), "router", lambda: time.time_ns() - 3_000_000_000)
    beating = Beating(network.open(robot), Echo())
    try:
        told = beating.watcher.wait(Health, lambda health: "clock_offset_ms" in health.gauges)
    finally:
        beating.heartbeat.close()
    # The router's clock is 3 s behind, so this one is 3 s ahead.
    assert abs(told.gauges["clock_offset_ms"] - 3000) <= told.gauges["clock_error_ms"]


def test_counters_of_one_name_add_up(beating: Beating) -> None:
    beating.activity.count("handled")
    beating.node.handled = [1, 2]
    assert beating.watcher.wait_for_counters(handled=3).counters["handled"] == 3


def test_rates_are_messages_per_second_of_the_last_period(beating: Beating) -> None:
    # 20 messages between two heartbeats: 20 / (their distance).
    beating.activity.count("sent_people")
    before = beating.watcher.wait_for_counters(sent_people=1)
    for _ in range(20):
        beating.activity.count("sent_people")
    total = 0.0
    while total < 19.0:
        health = beating.watcher.wait(Health)
        total += health.gauges["sent_people_hz"] * (health.stamp_ns - before.stamp_ns) / 1e9
        before = health
    assert total == pytest.approx(20.0, rel=0.3)
    assert beating.watcher.wait(Health).gauges["sent_people_hz"] == 0.0
    assert beating.watcher.wait(Health).counters["sent_people"] == 21


def test_the_last_heartbeat_says_stopping(beating: Beating) -> None:
    beating.wait("ready")
    beating.heartbeat.close()
    assert beating.wait("stopping").pid > 0


def test_a_status_that_fails_does_not_stop_the_heart(beating: Beating) -> None:
    broken = threading.Event()

    def fail() -> Status:
        broken.set()
        raise RuntimeError("a bug in the node")

    status = beating.node.status
    beating.node.status = fail  # type: ignore[method-assign]
    assert broken.wait(WAIT_S)
    beating.node.status = status  # type: ignore[method-assign]
    beating.wait("ready")


def test_the_longest_work_counts() -> None:
    activity, started, release = Activity(), threading.Event(), threading.Event()
    assert activity.longest_busy_s() == 0.0

    def hang() -> None:
        with activity.busy():
            started.set()
            release.wait(WAIT_S)

    thread = threading.Thread(target=hang)
    thread.start()
    assert started.wait(WAIT_S)
    assert activity.longest_busy_s() > 0.0
    release.set()
    thread.join()
    assert activity.longest_busy_s() == 0.0


def test_what_does_not_come_and_who_tells_it(
    beating: Beating, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(throughput, "QUIET_S", 0.2)
    monkeypatch.setattr(Echo, "required_inputs", (Detections,))
    bus = beating.bus
    watcher = Watcher(bus, Health)
    other = Heartbeat(Echo(), bus, ProcessId("tracker", "tracker-1", "robot"), Inbox(), Activity())
    told = watcher.wait(Health, lambda h: (h.service, h.state) == ("tracker", "degraded"))
    other.close()
    assert told.reason == "no detections have come yet, for 0 s"
    assert told.release == importlib.metadata.version("people4d")
    last = watcher.wait(Health, lambda h: (h.service, h.state) == ("tracker", "stopping"))
    assert last.reason == ""
