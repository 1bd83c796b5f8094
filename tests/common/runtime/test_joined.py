"""Services that share a process: messages in memory, the same behaviour seen from outside."""

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import pytest

from common.runtime import joined, process
from common.runtime.joined import ServiceBuild
from common.runtime.loop import Loop
from common.runtime.node import LoopCallbacks, Node
from common.transport.exchange import Exchange
from common.transport.trace import ProcessId
from common.transport.zenoh_bus import ZenohBus, read_config
from people4d import codec
from people4d.errors import ConfigError
from people4d.messages import Detections, Health, Message, Tracks
from tests.common.nodes import Echo, Source, detections
from tests.contract.examples import BY_NAME
from tests.network import WAIT_S, Network, Watcher

pytestmark = pytest.mark.network


class Caller(Source):
    """Sends a calibration, then Detections until a stop; finishes on request."""

    def __init__(self) -> None:
        super().__init__(1)
        self.due: list[Message] = []
        self.finished = False

    def tick(self, now_ns: int) -> list[Message]:
        due, self.due = self.due, []
        return due

    def wake_ns(self) -> int | None:
        return 0 if self.due else None

    def is_finished(self) -> bool:
        return self.finished

    def status(self) -> Any:
        return msgspec.structs.replace(
            super().status(), state="finished" if self.finished else "ready"
        )


class Pair:
    """A caller and an echo on one bus with an exchange, and a separate session."""

    def __init__(self, network: Network) -> None:
        self.robot = network.robot()
        self.network = network
        config = read_config(None, "peer", network.environment)
        self.bus = ZenohBus(config, self.robot, exchange=Exchange())
        self.heard: list[Message] = []
        self.caller, self.echo = Caller(), Echo(self.heard.append)
        self.loops = [
            Loop(node, self.bus, ProcessId(name, f"{name}-1", "here"))
            for name, node in (("caller", self.caller), ("echo", self.echo))
        ]
        self.threads = [threading.Thread(target=loop.run) for loop in self.loops]
        for thread in self.threads:
            thread.start()
        for loop in self.loops:
            assert loop.ready.wait(WAIT_S)

    def watch(self, *kinds: type[Message]) -> Watcher:
        return Watcher(self.network.open(self.robot), *kinds)

    def send(self, message: Message) -> None:
        self.caller.due.append(message)
        self.loops[0].inbox.wake()

    def wait_heard(self, number: int) -> Message:
        deadline_s = time.monotonic() + WAIT_S
        while time.monotonic() < deadline_s and all(m.sequence != number for m in list(self.heard)):
            time.sleep(0.005)
        return next(m for m in self.heard if m.sequence == number)

    def close(self) -> None:
        for loop, thread in zip(self.loops, self.threads, strict=True):
            loop.stop()
            thread.join(WAIT_S)
            assert not thread.is_alive()
        self.bus.close()


@pytest.fixture
def pair(network: Network) -> Iterator[Pair]:
    made = Pair(network)
    yield made
    made.close()


def test_a_message_is_heard_inside_and_outside_with_its_trace(pair: Pair) -> None:
    watcher = pair.watch(Tracks, Detections)
    pair.send(detections(7))
    assert watcher.wait(Detections).sequence == 7
    answer = watcher.wait(Tracks)
    assert [span.stage for span in answer.trace] == [
        "caller.publish",
        "echo.decode",
        "echo.queue",
        "echo.work",
        "echo.publish",
    ]
    assert [span.process for span in answer.trace[:2]] == ["caller-1@here", "echo-1@here"]
    assert [m.sequence for m in pair.heard] == [7]  # once, not again through Zenoh


def test_a_message_is_encoded_only_for_subscribers_outside(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("common.transport.zenoh_publisher.UNSURE_S", 0.0)
    encoded: list[str] = []

    def count(message: Message, *rest: Any) -> bytes:
        encoded.append(type(message).__name__)
        return codec.encode(message, *rest)

    monkeypatch.setattr("common.transport.zenoh_bus.encode", count)
    pair.send(detections(1))
    pair.wait_heard(1)
    assert "Detections" not in encoded
    watcher = pair.watch(Detections)
    number = 2
    with contextlib.suppress(TimeoutError):
        while "Detections" not in encoded and number < 2000:  # until the subscription is known
            pair.send(detections(number))
            pair.wait_heard(number)
            number += 1
    assert watcher.wait(Detections).sequence >= 2


def is_of(instance: str) -> Callable[[Health], bool]:
    return lambda health: health.instance == instance


def test_each_service_has_its_own_heartbeat_and_token(pair: Pair) -> None:
    watcher = pair.watch(Health)
    for name in ("caller-1", "echo-1"):
        assert watcher.wait(Health, is_of(name)).state == "ready"
    outside, expected = pair.network.open(pair.robot), {("caller", "caller-1"), ("echo", "echo-1")}
    present: set[tuple[str, str]] = set()
    deadline_s = time.monotonic() + WAIT_S
    while present != expected and time.monotonic() < deadline_s:  # tokens spread by themselves
        present = {(s, instance) for robot, s, instance in outside.present() if robot == pair.robot}
    assert present == expected


def test_a_latched_message_comes_once_to_a_service_beside_it(network: Network) -> None:
    info = BY_NAME["CameraInfo"]
    got: list[Message] = []

    class Listener(Echo):
        inputs = (type(info), Detections)

        def handle(self, message: Message, now_ns: int) -> Any:
            got.append(message)
            return ()

    config = read_config(None, "peer", network.environment)
    bus = ZenohBus(config, network.robot(), exchange=Exchange())
    bus.publish(info)
    loop = Loop(Listener(), bus, ProcessId("echo", "echo-1", "here"))
    thread = threading.Thread(target=loop.run)
    thread.start()
    assert loop.ready.wait(WAIT_S)
    bus.publish(info)
    bus.publish(detections(1))  # another topic, so it may overtake earlier messages
    outside = Watcher(network.open(bus.robot), type(info))
    outside.wait(type(info))  # a late joiner in another process gets the message, too
    loop.stop()
    thread.join(WAIT_S)
    bus.close()
    assert [type(m) for m in got].count(type(info)) == 2
    assert [type(m) for m in got].count(Detections) == 1


class NoConfig(msgspec.Struct):
    """No settings."""


def builds(nodes: dict[str, Node]) -> Callable[[Any], list[ServiceBuild]]:
    def build(name: str) -> ServiceBuild:
        return ServiceBuild(name, NoConfig, lambda _: nodes[name])

    return lambda names: [build(name) for name in names]


@contextlib.contextmanager
def environment(network: Network, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    robot = network.robot()
    for name, value in network.environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(joined, "prepare", lambda *_: None)
    monkeypatch.setattr(joined, "on_stop_signals", lambda _: None)
    yield robot


def test_the_process_ends_when_one_is_finished_and_the_others_handle_what_it_sent(
    network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    caller, echo = Caller(), Echo()
    caller.due = [detections(number) for number in range(20)]
    caller.finished = True
    with environment(network, monkeypatch) as robot:
        watcher = Watcher(network.open(robot), Tracks)
        arguments = ["tracker", "detector", "--robot", robot]
        nodes: dict[str, Node] = {"detector": caller, "tracker": echo}
        assert joined.main("test", builds(nodes), arguments) == 0
    assert echo.handled == list(range(20))
    assert echo.closed
    assert [watcher.wait(Tracks).sequence for _ in range(20)] == list(range(20))


def test_a_service_that_fails_ends_all(network: Network, monkeypatch: pytest.MonkeyPatch) -> None:
    echo = Echo()

    class Broken(Source):
        def close(self) -> None:
            raise RuntimeError("a bug at the end")

    nodes: dict[str, Node] = {"detector": Broken(0), "tracker": echo}
    with environment(network, monkeypatch) as robot:
        assert joined.main("test", builds(nodes), ["detector", "tracker", "--robot", robot]) == 1
    assert echo.closed


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--set", "reid.embedder=x"], "names no running service"),
        (["--instance", "detector-1"], "names 1 of 2 services"),
    ],
)
def test_wrong_options_are_errors(
    network: Network,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    arguments: list[str],
    problem: str,
) -> None:
    nodes: dict[str, Node] = {"detector": Source(1), "tracker": Echo()}
    with environment(network, monkeypatch) as robot:
        line = ["detector", "tracker", "--robot", robot, *arguments]
        assert joined.main("test", builds(nodes), line) == 1
    assert problem in caplog.text


def test_services_are_named_one_by_one() -> None:
    ids = process.process_ids(["detector", "tracker"], "detector-2+tracker-1")
    assert [(i.service, i.instance) for i in ids] == [
        ("detector", "detector-2"),
        ("tracker", "tracker-1"),
    ]
    with pytest.raises(ConfigError, match="names 3 of 2"):
        process.process_ids(["detector", "tracker"], "a+b+c")


@pytest.mark.parametrize("exchange", [None, Exchange()])
def test_only_apart_an_output_goes_out_before_the_rest_of_the_answer(
    network: Network, exchange: Exchange | None
) -> None:
    # In one process receiver and sender would compete for the interpreter.
    found: list[bool] = []

    class Attached(Source):
        def attach(self, loop: LoopCallbacks) -> None:
            found.append(loop.publish is None)

    config = read_config(None, "peer", network.environment)
    with contextlib.closing(ZenohBus(config, network.robot(), exchange=exchange)) as bus:
        Loop(Attached(0), bus, ProcessId("detector", "detector-1", "here")).run()
    assert found == [exchange is not None]
