"""Heartbeat of a process, received on the bus."""

import contextlib
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

pytestmark = pytest.mark.network

PROCESS_ID = ProcessId("detector", "detector-1", "robot")
NO_CLOCK = {"clock_steps": 0, "bad_clock": 0}


class HeartbeatRun:
    """A node with a heartbeat, and a watcher on the same session."""

    def __init__(self, bus: ZenohBus, node: Echo) -> None:
        self.bus, self.node, self.inbox, self.activity = bus, node, Inbox(), Activity()
        self.watcher = Watcher(bus, Health)
        self.heartbeat = Heartbeat(node, bus, PROCESS_ID, self.inbox, self.activity)

    def wait(self, state: str) -> Health:
        return self.watcher.wait(Health, lambda health: health.state == state)


@pytest.fixture
def run(network: Network, monkeypatch: pytest.MonkeyPatch) -> Iterator[HeartbeatRun]:
    monkeypatch.setattr(heartbeat, "PERIOD_S", 0.05)
    monkeypatch.setattr(heartbeat, "STALLED_AFTER_S", 0.2)
    run = HeartbeatRun(network.open(network.robot()), Echo())
    yield run
    run.heartbeat.close()


def test_heartbeat_names_its_process_and_counts_up(run: HeartbeatRun) -> None:
    first, second = run.wait("ready"), run.wait("ready")
    assert (first.service, first.instance, first.host) == ("detector", "detector-1", "robot")
    assert second.sequence == first.sequence + 1
    assert second.stamp_ns > first.stamp_ns
    assert first.gauges["memory_mb"] > 1
    assert first.reason == ""


def test_state_of_the_node_is_published(run: HeartbeatRun) -> None:
    run.node.state = "starting"
    run.wait("starting")
    run.node.state = "finished"
    run.wait("stopping")


def test_reason_of_many_lines_is_published_in_one(run: HeartbeatRun) -> None:
    run.node.reason = "the model failed:\n\x1b[31mno memory"
    run.node.state = "degraded"
    assert run.wait("degraded").reason == "the model failed:  [31mno memory"


@contextlib.contextmanager
def hanging(run: HeartbeatRun) -> Iterator[None]:
    """Let a thread work on one message until the block ends."""
    release = threading.Event()

    def hang() -> None:
        with run.activity.busy():
            release.wait(WAIT_S)

    thread = threading.Thread(target=hang)
    thread.start()
    yield
    release.set()
    thread.join()


def test_node_that_hangs_is_stalled_until_it_goes_on(run: HeartbeatRun) -> None:
    with hanging(run):
        assert run.wait("stalled").reason == "busy with one message for 0 s"
    run.wait("ready")


def test_thread_that_hangs_stalls_though_another_works(run: HeartbeatRun) -> None:
    with hanging(run):
        for _ in range(10):
            with run.activity.busy():
                run.watcher.wait(Health)
        run.wait("stalled")


def test_bytes_that_do_not_decode_degrade_the_process_for_a_while(
    run: HeartbeatRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("people4d.queue.FRESH_S", 0.3)
    run.inbox.add_payload(BY_NAME["detections"], "k", b"\xc1")
    health = run.wait("degraded")
    assert health.reason.startswith("message: expected MessagePack")
    assert health.counters["bad_detections"] == 1
    assert run.wait("ready").counters["bad_detections"] == 1


def test_counters_of_node_inbox_and_loop_are_published_together(run: HeartbeatRun) -> None:
    run.node.handled = [1, 2, 3]
    run.activity.count("errors")
    run.activity.count("errors")
    run.inbox.add_payload(BY_NAME["truth"], "k", b"")
    counters = run.watcher.wait_for_counters(handled=3, errors=2, bad_truth=1).counters
    # Zeros are published: they name the counters.
    assert counters == {"handled": 3, "skipped": 0, "errors": 2, "bad_truth": 1} | NO_CLOCK


def test_age_of_the_newest_input_is_published_and_grows(run: HeartbeatRun) -> None:
    received_ns = time.time_ns() - 500_000_000
    run.activity.note_taken("frames", received_ns)
    first = run.watcher.wait(Health, lambda health: "age_frames_ms" in health.gauges)
    second = run.watcher.wait(Health)
    assert 500 <= first.gauges["age_frames_ms"] < second.gauges["age_frames_ms"]


def test_clock_is_compared_with_that_of_the_router(
    network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(heartbeat, "PERIOD_S", 0.05)
    robot = network.robot()
    serve_time(network.open(robot), "router", lambda: time.time_ns() - 3_000_000_000)
    run = HeartbeatRun(network.open(robot), Echo())
    try:
        health = run.watcher.wait(Health, lambda health: "clock_offset_ms" in health.gauges)
    finally:
        run.heartbeat.close()
    # The router's clock is 3 s behind, so this one is 3 s ahead.
    assert abs(health.gauges["clock_offset_ms"] - 3000) <= health.gauges["clock_error_ms"]


def test_counters_of_one_name_add_up(run: HeartbeatRun) -> None:
    run.activity.count("handled")
    run.node.handled = [1, 2]
    assert run.watcher.wait_for_counters(handled=3).counters["handled"] == 3


def test_rates_are_messages_per_second_of_the_last_period(run: HeartbeatRun) -> None:
    # 20 messages between two heartbeats: 20 / (their distance).
    run.activity.count("sent_people")
    before = run.watcher.wait_for_counters(sent_people=1)
    for _ in range(20):
        run.activity.count("sent_people")
    total = 0.0
    while total < 19.0:
        health = run.watcher.wait(Health)
        total += health.gauges["sent_people_hz"] * (health.stamp_ns - before.stamp_ns) / 1e9
        before = health
    assert total == pytest.approx(20.0, rel=0.3)
    assert run.watcher.wait(Health).gauges["sent_people_hz"] == 0.0
    assert run.watcher.wait(Health).counters["sent_people"] == 21


def test_the_last_heartbeat_says_stopping(run: HeartbeatRun) -> None:
    run.wait("ready")
    run.heartbeat.close()
    assert run.wait("stopping").pid > 0


def test_status_that_raises_does_not_stop_the_heartbeat(run: HeartbeatRun) -> None:
    broken = threading.Event()

    def fail() -> Status:
        broken.set()
        raise RuntimeError("a bug in the node")

    status = run.node.status
    run.node.status = fail  # type: ignore[method-assign]
    assert broken.wait(WAIT_S)
    run.node.status = status  # type: ignore[method-assign]
    run.wait("ready")


def test_longest_busy_thread_counts() -> None:
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


def test_missing_input_degrades_the_process_that_requires_it(
    run: HeartbeatRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(throughput, "QUIET_S", 0.2)
    monkeypatch.setattr(Echo, "required_inputs", (Detections,))
    bus = run.bus
    watcher = Watcher(bus, Health)
    other = Heartbeat(Echo(), bus, ProcessId("tracker", "tracker-1", "robot"), Inbox(), Activity())
    health = watcher.wait(Health, lambda h: (h.service, h.state) == ("tracker", "degraded"))
    other.close()
    assert health.reason == "no detections have come yet, for 0 s"
    assert health.release == importlib.metadata.version("people4d")
    last = watcher.wait(Health, lambda h: (h.service, h.state) == ("tracker", "stopping"))
    assert last.reason == ""
