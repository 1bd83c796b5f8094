"""Delivery of events to a web address and an MQTT broker, with failures and retries."""

import json
import re
import socketserver
import struct
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from io import BufferedIOBase
from pathlib import Path
from typing import Any

import pytest

from common.runtime.node import LoopCallbacks
from common.transport.ports import free_port
from people4d.errors import ConfigError
from people4d.messages import Event
from services.events.build import build
from services.events.config import EventsConfig
from services.events.delivery import Delivery
from services.events.journal import JOURNAL
from services.events.mqtt import PASSWORD
from tests.builders import tracks
from tests.events.test_node import see, start

WAIT_S = 30


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.events.delivery.WAITS_S", (0.0, 0.1))


def until(condition: Callable[[], object]) -> None:
    end_s = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.02)


def person_comes_and_leaves(folder: Path, **settings: Any) -> Any:
    """Make two events in a service; return its node."""
    node, _ = start(folder, **settings)
    see(node, 0)
    see(node, 5, x=30.0)
    node.handle(tracks(stamp_ns=10**10), 0)
    return node


class RawReceiver(socketserver.ThreadingTCPServer):
    """Takes POST requests, and answers the first with bytes of any kind, all others with 200."""

    allow_reuse_address = daemon_threads = True

    def __init__(self, first: Iterable[bytes]) -> None:
        super().__init__(("127.0.0.1", 0), RawConnection)
        self.first: Iterable[bytes] | None = first
        self.requests: list[str] = []
        self.events: list[dict[str, Any]] = []


class RawConnection(socketserver.StreamRequestHandler):
    def handle(self) -> None:
        receiver = self.server
        assert isinstance(receiver, RawReceiver)
        receiver.requests.append(self.rfile.readline().decode().strip())
        while (line := self.rfile.readline().strip().lower()) != b"":
            if line.startswith(b"content-length:"):
                length = int(line.partition(b":")[2])
        receiver.events.append(json.loads(self.rfile.read(length)))
        answer, receiver.first = receiver.first, None
        with suppress(OSError):  # the other may leave before the end
            for part in answer or [b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n"]:
                self.wfile.write(part)


@contextmanager
def raw_receiver(first: Iterable[bytes]) -> Iterator[RawReceiver]:
    server = RawReceiver(first)
    threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()


def byte_after_byte() -> Iterator[bytes]:
    """Yield the bytes of an answer that never ends, each within the timeout."""
    while True:
        yield b"H"
        threading.Event().wait(0.1)


@pytest.mark.parametrize(
    ("first", "reason"),
    [
        ([b"I speak no HTTP.\r\n\r\n"], "I speak no HTTP"),
        ([b"HTTP/1.1 200 OK\r\nX: " + b"x" * 70_000 + b"\r\n\r\n"], "header line"),
        ([b"HTTP/1.1 200 OK\r\n" + b"X: x\r\n" * 200 + b"\r\n"], "100 headers"),
        ([b""], "without response"),
        ([b"HTTP/1.1 500 Oh\r\n\r\n"], "answers 500"),
        (byte_after_byte(), "no answer within|timed out"),
    ],
)
def test_failed_post_is_reported_and_retried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, first: Iterable[bytes], reason: str
) -> None:
    monkeypatch.setattr("services.events.webhook.TIMEOUT_S", 1.0)
    with raw_receiver(first) as server:
        node = person_comes_and_leaves(
            tmp_path, webhook=f"http://127.0.0.1:{server.server_address[1]}/events?a=1"
        )
        until(lambda: node.status().counters["webhook_failed"])
        assert node.status().state == "degraded"
        assert re.search(reason, node.status().reason), node.status().reason
        until(lambda: node.status().counters["webhook_sent"] == 2)
        until(lambda: node.status().state == "ready")
        node.close()
    assert server.requests == ["POST /events?a=1 HTTP/1.1"] * 3
    assert [(e["sequence"], e["robot"]) for e in server.events] == [(n, "robby") for n in (0, 0, 1)]


@pytest.mark.parametrize("status", [302, 307])
def test_redirect_is_not_followed_and_counts_as_a_failure(tmp_path: Path, status: int) -> None:
    with raw_receiver([]) as other:
        address = f"http://127.0.0.1:{other.server_address[1]}/"
        answer = f"HTTP/1.1 {status} Elsewhere\r\nLocation: {address}\r\n\r\n".encode()
        with raw_receiver([answer]) as server:
            node = person_comes_and_leaves(
                tmp_path, webhook=f"http://127.0.0.1:{server.server_address[1]}/"
            )
            until(lambda: node.status().counters["webhook_failed"])
            assert f"answers {status}" in node.status().reason
            until(lambda: node.status().counters["webhook_sent"] == 2)
            node.close()
    assert len(server.requests) == 3
    assert other.requests == []


class Holding:
    """Receiver that does not return until its test releases it."""

    name = "holding"

    def __init__(self) -> None:
        self.released = threading.Event()

    def send(self, event: Event, body: bytes) -> None:
        self.released.wait()

    def close(self) -> None:
        pass


def test_receiver_that_does_not_return_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.events.delivery.TIMEOUT_S", -0.9)
    person_comes_and_leaves(tmp_path).close()
    receiver = Holding()
    delivery = Delivery(receiver, tmp_path / JOURNAL, "robby")
    until(lambda: delivery.problem)
    assert "no answer for" in delivery.problem
    receiver.released.set()
    until(lambda: not delivery.problem)
    delivery.close()


def test_journal_that_cannot_be_read_is_reported_and_tried_again(tmp_path: Path) -> None:
    person_comes_and_leaves(tmp_path).close()
    journal, moved = tmp_path / JOURNAL, tmp_path / "moved"
    journal.rename(moved)
    journal.mkdir()
    receiver = Holding()
    receiver.released.set()
    delivery = Delivery(receiver, journal, "robby")
    until(lambda: "cannot be used" in delivery.problem)
    journal.rmdir()
    moved.rename(journal)
    until(lambda: delivery.counters["holding_sent"] == 2)
    delivery.close()
    assert not delivery.problem


class Broker(socketserver.ThreadingTCPServer):
    """Broker of MQTT 3.1.1 that only receives: answers CONNECT, PUBLISH and PINGREQ."""

    allow_reuse_address = daemon_threads = True

    def __init__(
        self, port: int, acknowledges: bool = True, accepts: bool = True, greeting: bytes = b""
    ) -> None:
        super().__init__(("127.0.0.1", port), BrokerConnection)
        self.acknowledges, self.accepts, self.greeting = acknowledges, accepts, greeting
        self.published: list[tuple[str, dict[str, Any]]] = []
        self.connects: list[bytes] = []


class BrokerConnection(socketserver.StreamRequestHandler):
    def handle(self) -> None:
        broker = self.server
        assert isinstance(broker, Broker)
        self.wfile.write(broker.greeting)
        while header := self.rfile.read(1):
            body = self.rfile.read(remaining_length(self.rfile))
            kind = header[0] >> 4
            if kind == 1:
                broker.connects.append(body)
                self.wfile.write(b"\x20\x02\x00" + bytes([0 if broker.accepts else 5]))
            elif kind == 3:
                (length,) = struct.unpack_from(">H", body)
                topic, packet_id = body[2 : 2 + length].decode(), body[2 + length : 4 + length]
                broker.published.append((topic, json.loads(body[4 + length :])))
                if broker.acknowledges:
                    self.wfile.write(b"\x40\x02" + packet_id)
            elif kind == 12:
                self.wfile.write(b"\xd0\x00")


def remaining_length(stream: BufferedIOBase) -> int:
    length = shift = 0
    while True:
        (byte,) = stream.read(1)
        length |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return length


@contextmanager
def broker(port: int = 0, **settings: Any) -> Iterator[Broker]:
    server = Broker(port, **settings)
    threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()


def test_broker_gets_each_event_once_though_it_was_away(tmp_path: Path) -> None:
    port = free_port()
    node = person_comes_and_leaves(tmp_path, mqtt=f"mqtt://127.0.0.1:{port}")
    until(lambda: node.status().counters["mqtt_failed"])
    assert node.status().state == "degraded"
    assert "mqtt does not take events" in node.status().reason
    with broker(port) as server:
        until(lambda: node.status().counters["mqtt_sent"] == 2)
        until(lambda: node.status().state == "ready")
        node.close()
    assert [topic for topic, _ in server.published] == ["people4d/robby/events"] * 2
    assert [event["sequence"] for _, event in server.published] == [0, 1]
    assert [event["kind"] for _, event in server.published] == ["appeared", "disappeared"]


def test_events_wait_over_a_restart(tmp_path: Path) -> None:
    port = free_port()
    settings = {"mqtt": f"mqtt://127.0.0.1:{port}/hall/events"}
    node = person_comes_and_leaves(tmp_path, **settings)
    until(lambda: node.status().counters["mqtt_failed"])
    node.close()
    with broker(port) as server:
        again, _ = start(tmp_path, **settings)
        until(lambda: again.status().counters["mqtt_sent"] == 2)
        again.close()
    assert [topic for topic, _ in server.published] == ["hall/events"] * 2


def test_user_and_password_go_to_the_broker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(PASSWORD, "secret")
    with broker(accepts=False) as server:
        port = server.server_address[1]
        node = person_comes_and_leaves(tmp_path, mqtt=f"mqtt://ann@127.0.0.1:{port}")
        until(lambda: node.status().counters["mqtt_failed"])
        node.close()
    assert b"\x00\x03ann\x00\x06secret" in server.connects[0]
    assert "Not authorized" in node.status().reason


def test_broker_that_acknowledges_nothing_is_a_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.events.mqtt.TIMEOUT_S", 0.5)
    with broker(acknowledges=False) as server:
        port = server.server_address[1]
        node = person_comes_and_leaves(tmp_path, mqtt=f"mqtt://127.0.0.1:{port}")
        until(lambda: node.status().counters["mqtt_failed"])
        assert "acknowledgement" in node.status().reason
        server.acknowledges = True
        until(lambda: node.status().counters["mqtt_sent"] == 2)
        node.close()


def test_broker_that_sends_garbage_is_reported_and_tried_again(tmp_path: Path) -> None:
    with broker(greeting=b"\x30\x01\x00") as server:  # a message too short for its topic
        port = server.server_address[1]
        node = person_comes_and_leaves(tmp_path, mqtt=f"mqtt://127.0.0.1:{port}")
        until(lambda: node.status().counters["mqtt_failed"])
        server.greeting = b""
        until(lambda: node.status().counters["mqtt_sent"] == 2)
        node.close()


@pytest.mark.parametrize(
    "setting",
    [
        *(
            {"webhook": url}
            for url in ("file:///etc/hostname", "host/x", "http://", "http://h:port")
        ),
        *({"mqtt": url} for url in ("http://host/x", "mqtt://", "mqtt://h:port", "mqtt://h/all/#")),
    ],
)
def test_invalid_address_is_an_error(tmp_path: Path, setting: dict[str, str]) -> None:
    with pytest.raises(ConfigError, match="is not an address"):
        start(tmp_path, **setting)


def test_receiver_without_a_state_folder_is_an_error() -> None:
    node = build(EventsConfig(mqtt="mqtt://host"))
    with pytest.raises(ConfigError, match="state folder"):
        node.attach(LoopCallbacks(robot="robby"))
