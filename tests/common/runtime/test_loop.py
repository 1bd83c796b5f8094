"""The run loop on a real bus, and a real process."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import pytest

from common.runtime import loop as loop_module
from common.runtime import process
from common.runtime.loop import Loop, LoopSettings
from common.runtime.node import LoopCallbacks, Node
from common.transport.ports import free_port
from common.transport.trace import ProcessId
from people4d.messages import Health, Message, Tracks, Truth
from people4d.messages.base import MAX_TRACE
from services.router.build import build
from services.router.config import RouterConfig
from tests import builders
from tests.common.nodes import Echo, Source, detections
from tests.contract.examples import SPAN
from tests.network import WAIT_S, Network, Watcher

pytestmark = pytest.mark.network

PROCESS_ID = ProcessId("echo", "echo-1", "robot")


@pytest.fixture(autouse=True)
def quick_heartbeat(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("common.runtime.heartbeat.PERIOD_S", 0.05)


class Running:
    """A loop in a thread, and a session that feeds and watches it."""

    def __init__(self, network: Network, node: Node, workers: int) -> None:
        robot = network.robot()
        self.outside = network.open(robot)
        self.watcher = Watcher(self.outside, Tracks, Truth, Health)
        self.loop = Loop(node, network.open(robot), PROCESS_ID, LoopSettings(workers))
        self.thread = threading.Thread(target=self.loop.run)
        self.thread.start()
        # Its subscriptions are declared before its first heartbeat is sent.
        self.watcher.wait(Health)

    def send(self, *messages: Message) -> None:
        for message in messages:
            self.outside.publish(message)

    def tracks(self, count: int) -> list[int]:
        return [self.watcher.wait(Tracks).sequence for _ in range(count)]


@contextlib.contextmanager
def running(network: Network, node: Node, workers: int = 1) -> Iterator[Running]:
    run = Running(network, node, workers)
    try:
        yield run
    finally:
        run.loop.stop()
        run.thread.join(WAIT_S)
        assert not run.thread.is_alive()


def test_messages_go_to_the_node_and_answers_out_with_their_times(network: Network) -> None:
    node = Echo()
    with running(network, node) as run:
        run.send(msgspec.structs.replace(detections(7), trace=(SPAN,)))
        answer = run.watcher.wait(Tracks)
    assert (answer.sequence, answer.stamp_ns) == (7, 1007)
    stages = [span.stage for span in answer.trace]
    assert stages == ["camera.read", "echo.decode", "echo.queue", "echo.work", "echo.publish"]
    assert {span.process for span in answer.trace[1:]} == {"echo-1@robot"}
    times = [t for span in answer.trace[1:] for t in (span.start_ns, span.end_ns)]
    assert times == sorted(times)
    assert node.closed


def test_a_trace_that_is_full_stays_valid(network: Network) -> None:
    with running(network, Echo()) as run:
        run.send(msgspec.structs.replace(detections(1), trace=(SPAN,) * MAX_TRACE))
        assert len(run.watcher.wait(Tracks).trace) == MAX_TRACE


def test_two_workers_work_at_once_and_answer_in_order(network: Network) -> None:
    # The first message is not done before the second is: only two workers can get through.
    second_done = threading.Event()

    def hook(message: Message) -> None:
        if message.sequence % 2 == 0:
            assert second_done.wait(WAIT_S)
            second_done.clear()
        else:
            second_done.set()

    with running(network, Echo(hook), workers=2) as run:
        for sequence in range(0, 20, 2):
            run.send(detections(sequence), detections(sequence + 1))
            assert run.tracks(2) == [sequence, sequence + 1]


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_in_the_node_is_counted_and_holds_up_nothing(
    network: Network, workers: int
) -> None:
    with running(network, Echo(), workers) as run:
        run.send(detections(1), detections(2, "bad"), detections(3), detections(4, "bad"))
        run.send(detections(5))
        assert run.tracks(3) == [1, 3, 5]
        run.watcher.wait_for_counters(errors=2, received_detections=5, sent_people=3)


def test_an_error_in_every_message_degrades_the_process_and_is_logged_once(
    network: Network, caplog: pytest.LogCaptureFixture
) -> None:
    # A detector that fails on every frame must not be ready.
    with running(network, Echo()) as run:
        run.send(*(detections(sequence, "bad") for sequence in range(12)))
        health = run.watcher.wait_for_counters(errors=12)
    assert health.state == "degraded"
    assert health.reason.startswith("the node failed (RuntimeError in nodes.py line ")
    assert "12 in all" in health.reason
    tracebacks = [record for record in caplog.records if record.exc_info]
    assert len(tracebacks) == 1
    assert [r.message for r in caplog.records if "10 times by now" in r.message]


class Unsendable(Truth, frozen=True, kw_only=True):
    """A message that is not in the table of topics."""


def test_an_answer_that_cannot_be_sent_is_counted_and_holds_up_nothing(network: Network) -> None:
    # A failure that ends the sending thread would lose all later messages.
    node = Echo()

    def hook(message: Message) -> None:
        if message.sequence == 1:
            node.due.append(Unsendable(stamp_ns=0, sequence=0, frame_id="map"))

    node.hook = hook
    with running(network, node) as run:
        run.send(detections(1), detections(2))
        assert run.tracks(2) == [1, 2]
        run.watcher.wait_for_counters(errors=1, sent_people=2)


def test_an_error_in_tick_is_counted(network: Network) -> None:
    class Broken(Echo):
        def tick(self, now_ns: int) -> Sequence[Message]:
            raise RuntimeError("a bug in the node")

    with running(network, Broken()) as run:
        run.send(detections(1))
        assert run.tracks(1) == [1]
        run.watcher.wait_for_counters(errors=2)


def test_a_node_that_is_finished_ends_the_loop_after_its_outputs(network: Network) -> None:
    source = Source(5)
    robot = network.robot()
    watcher = Watcher(network.open(robot), Truth, Health)
    Loop(source, network.open(robot), PROCESS_ID).run()
    assert source.closed.is_set()
    assert [watcher.wait(Truth).sequence for _ in range(5)] == list(range(5))
    watcher.wait(Health, lambda h: h.state == "stopping" and h.counters["sent_truth"] == 5)


def test_waiting_messages_are_handled_after_a_stop(network: Network) -> None:
    started, release = threading.Event(), threading.Event()

    def hook(message: Message) -> None:
        started.set()
        assert release.wait(WAIT_S)

    node = Echo(hook)
    with running(network, node) as run:
        run.send(*(detections(sequence) for sequence in range(4)))
        assert started.wait(WAIT_S)
        run.watcher.wait_for_counters(received_detections=4)
        run.loop.stop()
        release.set()
        assert run.tracks(4) == [0, 1, 2, 3]
    assert node.handled == [0, 1, 2, 3]
    assert node.closed


def test_node_can_wake_the_loop(network: Network, monkeypatch: pytest.MonkeyPatch) -> None:
    class Fed(Echo):
        def attach(self, loop: LoopCallbacks) -> None:
            self.wake = loop.wake

    monkeypatch.setattr(loop_module, "LONGEST_WAIT_S", 10 * WAIT_S)
    node = Fed()
    with running(network, node) as run:
        node.due.append(builders.truth(sequence=3))
        node.wake()
        assert run.watcher.wait(Truth).sequence == 3


def test_tick_is_called_at_wake_ns(network: Network, monkeypatch: pytest.MonkeyPatch) -> None:
    class Timed(Echo):
        at_ns: int | None = None

        def wake_ns(self) -> int | None:
            return self.at_ns

        def tick(self, now_ns: int) -> Sequence[Message]:
            if self.at_ns is None:
                self.at_ns = now_ns + 50_000_000
            elif now_ns >= self.at_ns:
                self.at_ns = None
                return [builders.truth()]
            return ()

    monkeypatch.setattr(loop_module, "LONGEST_WAIT_S", 1.0)
    with running(network, Timed()) as run:
        run.send(detections(1))
        run.watcher.wait(Truth)


def test_node_that_hangs_still_has_a_heartbeat(
    network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("common.runtime.heartbeat.STALLED_AFTER_S", 0.2)
    release = threading.Event()

    def hang(_: Message) -> None:
        release.wait(WAIT_S)

    with running(network, Echo(hang)) as run:
        run.send(detections(1))
        run.watcher.wait(Health, lambda health: health.state == "stalled")
        release.set()
        run.watcher.wait(Health, lambda health: health.state == "ready")


@pytest.fixture
def router_process(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    environment = os.environ | {"PEOPLE4D_LISTEN": f"tcp/127.0.0.1:{free_port()}"}
    command = [sys.executable, "-m", "services.router", "--instance", "router-1"]
    with subprocess.Popen(
        command, env=environment, stderr=subprocess.PIPE, text=True
    ) as running_process:
        yield running_process
        running_process.kill()


@pytest.mark.processes
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_process_stops_on_a_signal_with_exit_code_0(
    router_process: subprocess.Popen[str], number: signal.Signals
) -> None:
    assert router_process.stderr
    for line in router_process.stderr:
        if "started" in line:
            break
    router_process.send_signal(number)
    assert router_process.wait(WAIT_S) == 0
    assert "router-1 INFO stopped" in router_process.stderr.read()


def test_a_failure_at_the_start_is_one_sentence_and_exit_code_1(
    network: Network, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def run(*arguments: str) -> int:
        return process.main("router", RouterConfig, build, mode="router", arguments=arguments)

    monkeypatch.setenv("PEOPLE4D_LISTEN", network.endpoint)
    assert run() == 1
    assert "Zenoh cannot listen" in caplog.text
    assert "Traceback" not in caplog.text
    assert run("--set", "colour=red") == 1
    assert "configuration of router has no field 'colour'. Its fields are none." in caplog.text
    monkeypatch.setenv("PEOPLE4D_LISTEN", f"tcp/127.0.0.1:{free_port()}")
    assert run("--instance", "a/b") == 1
    assert "instance: expected 1 to 64" in caplog.text


class Holding(Echo):
    """Withholds its answers until `flush`."""

    def __init__(self) -> None:
        super().__init__()
        self.held: list[Message] = []

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        self.held += super().handle(message, now_ns)
        return ()

    def flush(self, now_ns: int) -> Sequence[Message]:
        return self.held


def test_outputs_held_back_are_published_at_the_end(network: Network) -> None:
    with running(network, Holding()) as run:
        run.send(*map(detections, range(3)))
        run.watcher.wait_for_counters(handled=3)
        run.loop.stop()
        assert run.tracks(3) == [0, 1, 2]


@pytest.mark.parametrize("workers", [1, 3])
def test_received_messages_are_answered_after_a_stop(network: Network, workers: int) -> None:
    first = threading.Event()
    with running(network, Echo(lambda _: first.set()), workers) as run:
        run.send(*map(detections, range(60)))
        assert first.wait(WAIT_S)
        run.loop.stop()  # during the messages
        counters = run.watcher.wait(Health, lambda h: h.state == "stopping").counters
        assert counters["received_detections"] == counters["sent_people"] > 0
        assert run.tracks(counters["sent_people"]) == list(range(counters["sent_people"]))
