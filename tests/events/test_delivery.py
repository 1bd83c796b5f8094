"""Events for receivers outside: a web address and a broker of MQTT that are away for a time."""

import json
import socketserver
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from io import BufferedIOBase
from pathlib import Path
from typing import Any

import pytest

from common.runtime.node import LoopCallbacks
from common.transport.ports import free_port
from people4d.errors import ConfigError
from services.events.build import build
from services.events.config import EventsConfig
from services.events.mqtt import PASSWORD, MqttBroker
from tests.builders import tracks
from tests.events.test_node import see, start

WAIT_S = 30


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


def test_webhook_gets_each_event_once_though_it_was_away(tmp_path: Path) -> None:
    taken: list[dict[str, Any]] = []

    class Receiver(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            taken.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(503 if len(taken) == 1 else 200)
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            pass

    server = HTTPServer(("127.0.0.1", 0), Receiver)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    url = f"http://127.0.0.1:{server.server_port}/"
    node = person_comes_and_leaves(tmp_path, webhook=url)
    until(lambda: node.status().counters["webhook_sent"] == 2)
    node.close()
    server.shutdown()
    server.server_close()
    assert [event["sequence"] for event in taken] == [0, 0, 1]
    assert taken[0]["robot"] == "robby"
    assert node.status().counters["webhook_failed"] == 1


class Broker(socketserver.ThreadingTCPServer):
    """Broker of MQTT 3.1.1 that only receives: answers CONNECT, PUBLISH and PINGREQ."""

    allow_reuse_address = daemon_threads = True

    def __init__(self, port: int, acknowledges: bool = True, accepts: bool = True) -> None:
        super().__init__(("127.0.0.1", port), BrokerConnection)
        self.acknowledges, self.accepts = acknowledges, accepts
        self.published: list[tuple[str, dict[str, Any]]] = []
        self.connects: list[bytes] = []


class BrokerConnection(socketserver.StreamRequestHandler):
    def handle(self) -> None:
        broker = self.server
        assert isinstance(broker, Broker)
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
    threading.Thread(target=server.serve_forever, daemon=True).start()
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


@pytest.mark.parametrize(
    "address", ["http://host/x", "mqtt://", "mqtt://host:port", "mqtt://host/all/#"]
)
def test_address_that_is_none_is_an_error(tmp_path: Path, address: str) -> None:
    with pytest.raises(ConfigError, match="no address"):
        start(tmp_path, mqtt=address)


def test_receiver_without_a_state_folder_is_an_error() -> None:
    node = build(EventsConfig(mqtt="mqtt://host"))
    with pytest.raises(ConfigError, match="state folder"):
        node.attach(LoopCallbacks(robot="robby"))


def test_broker_without_the_library_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "paho.mqtt", None)
    with pytest.raises(ConfigError, match="paho-mqtt"):
        MqttBroker("mqtt://host", "robby")
