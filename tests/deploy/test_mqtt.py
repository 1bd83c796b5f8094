"""People and zones at a real MQTT broker, mosquitto, with the entities of Home Assistant."""

import getpass
import json
import os
import queue
import shutil
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from paho.mqtt import client as paho
from paho.mqtt.enums import CallbackAPIVersion

from common.transport.ports import free_port
from deploy.exporters.mqtt import PERIOD_S, MqttExporter
from people4d.errors import ConfigError, People4dError
from people4d.messages import Tracks, Zone, Zones
from services.events.mqtt import PASSWORD
from tests.contract.examples import BY_NAME

pytestmark = pytest.mark.network

WAIT_S = 20.0
MOSQUITTO = shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin")
needs_mosquitto = pytest.mark.skipif(not MOSQUITTO, reason="mosquitto is not installed")
TRACKS = BY_NAME["Tracks"]
SQUARE_M = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 3.0], [0.0, 3.0]])  # around x 1 m, y 2 m
HALL = Zone(name="Hall, left", corners_m=SQUARE_M)
AWAY = Zone(name="away", corners_m=SQUARE_M + 10)


class Broker:
    """A process of mosquitto, and a client that stores its messages."""

    def __init__(self, folder: Path, port: int, *lines: str) -> None:
        assert MOSQUITTO
        self.port = port
        config = folder / "mosquitto.conf"
        lines = lines or ("allow_anonymous true",)
        always = (f"listener {port} 127.0.0.1", f"user {getpass.getuser()}")
        config.write_text("\n".join((*always, *lines)) + "\n")
        command = [MOSQUITTO, "-c", str(config)]
        self._process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        self._running = threading.Event()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()
        assert self._running.wait(WAIT_S)

    def _read(self) -> None:
        assert self._process.stderr
        with self._process.stderr as log:
            for line in log:
                if "running" in line:
                    self._running.set()

    def close(self) -> None:
        self._process.terminate()
        self._process.wait(WAIT_S)
        self._reader.join(WAIT_S)


class Listener:
    """A client of all topics."""

    def __init__(self, port: int) -> None:
        self.messages: dict[str, Any] = {}
        self._arrivals: queue.Queue[tuple[str, bytes]] = queue.Queue()
        client: Any = paho.Client(CallbackAPIVersion.VERSION2, "listener")
        self._client = client
        self._client.on_connect = lambda *_: self._client.subscribe("#", qos=1)
        self._client.on_message = lambda _c, _d, m: self._arrivals.put((m.topic, m.payload))
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()

    def until(self, met: Callable[[dict[str, Any]], bool]) -> None:
        """Receive until the newest messages of all topics meet a condition."""
        while not met(self.messages):
            topic, payload = self._arrivals.get(timeout=WAIT_S)
            text = payload.decode()
            self.messages[topic] = json.loads(text) if text[:1] == "{" else text

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    with closing(Broker(tmp_path, free_port())) as started:
        yield started


@pytest.fixture
def listener(broker: Broker) -> Iterator[Listener]:
    with closing(Listener(broker.port)) as joined:
        yield joined


def zones(*present: Zone) -> Zones:
    return Zones(stamp_ns=0, sequence=1, zones=present)


def entities(messages: dict[str, Any]) -> dict[str, str]:
    """Return the topics of all present entities by name."""
    found = {topic: value for topic, value in messages.items() if topic.endswith("/config")}
    return {value["name"]: topic for topic, value in found.items() if value}


@needs_mosquitto
def test_people_zones_and_entities_reach_the_broker(broker: Broker, listener: Listener) -> None:
    with closing(MqttExporter("robby", f"mqtt://127.0.0.1:{broker.port}")) as exporter:
        exporter.add_message(zones(HALL, AWAY))
        exporter.add_message(TRACKS)
        listener.until(lambda found: "people4d/robby/state" in found and len(entities(found)) == 5)
        found = listener.messages
        assert found["people4d/robby/status"] == "online"
        (track,) = found["people4d/robby/people"]["tracks"]
        assert track["position_m"] == [1, 2, 3]
        assert found["people4d/robby/people"]["robot"] == "robby"
        topics = entities(found)
        assert set(topics) == {"People", "Hall, left", "Hall, left people", "away", "away people"}
        state = found["people4d/robby/state"]
        assert state["people"] == 1
        hall, away = (topics[name].split("/")[3] for name in ("Hall, left", "away"))
        assert state["zones"] == {hall: 1, away: 0}
        occupancy = found[topics["Hall, left"]]
        assert topics["Hall, left"].startswith("homeassistant/binary_sensor/people4d_robby/zone_")
        assert occupancy["device_class"] == "occupancy"
        assert f"value_json.zones.{hall}" in occupancy["value_template"]
        assert occupancy["state_topic"] == "people4d/robby/state"
        assert occupancy["availability_topic"] == "people4d/robby/status"
        assert len({found[topic]["unique_id"] for topic in topics.values()}) == 5
    listener.until(lambda found: found["people4d/robby/status"] == "offline")


@needs_mosquitto
def test_entities_of_a_removed_zone_are_removed(broker: Broker, listener: Listener) -> None:
    with closing(MqttExporter("robby", f"mqtt://127.0.0.1:{broker.port}/site/a")) as exporter:
        exporter.add_message(zones(HALL, AWAY))
        listener.until(lambda found: len(entities(found)) == 5)
        exporter.add_message(zones(AWAY))
        listener.until(lambda found: len(entities(found)) == 3)
        assert set(entities(listener.messages)) == {"People", "away", "away people"}
        assert listener.messages["site/a/status"] == "online"


@needs_mosquitto
def test_people_are_sent_once_a_second_at_most(broker: Broker, listener: Listener) -> None:
    assert isinstance(TRACKS, Tracks)
    with closing(MqttExporter("robby", f"mqtt://127.0.0.1:{broker.port}")) as exporter:
        exporter.add_message(TRACKS)
        exporter.add_message(msgspec.structs.replace(TRACKS, tracks=()))
        exporter._sent_s -= PERIOD_S
        exporter.add_message(msgspec.structs.replace(TRACKS, sequence=99))
        listener.until(lambda found: found.get("people4d/robby/people", {}).get("sequence") == 99)
        assert listener.messages["people4d/robby/state"]["people"] == 1


@needs_mosquitto
def test_entities_are_announced_to_a_restarted_broker(tmp_path: Path) -> None:
    port = free_port()
    first = Broker(tmp_path, port)
    with closing(MqttExporter("robby", f"mqtt://127.0.0.1:{port}")) as exporter:
        exporter.add_message(zones(HALL))
        first.close()
        with closing(Broker(tmp_path, port)), closing(Listener(port)) as listener:
            listener.until(lambda found: len(entities(found)) == 3)
            assert listener.messages["people4d/robby/status"] == "online"


@needs_mosquitto
def test_refused_login_is_an_error_with_a_remedy(tmp_path: Path) -> None:
    (tmp_path / "passwords").touch()
    lines = ("allow_anonymous false", f"password_file {tmp_path}/passwords")
    with closing(Broker(tmp_path, free_port(), *lines)) as broker:
        with pytest.raises(People4dError, match=r"refuses: .*uthori") as caught:
            MqttExporter("robby", f"mqtt://ann@127.0.0.1:{broker.port}")
        assert PASSWORD in caught.value.hint


def test_absent_broker_is_an_error() -> None:
    with pytest.raises(People4dError, match="does not answer"):
        MqttExporter("robby", f"mqtt://127.0.0.1:{free_port()}")


def test_silent_broker_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deploy.exporters.mqtt.TIMEOUT_S", 0.2)
    refused = pytest.raises(People4dError, match="no answer in")
    with socket.create_server(("127.0.0.1", 0)) as silent, refused:
        MqttExporter("robby", f"mqtt://127.0.0.1:{silent.getsockname()[1]}")


def test_address_without_a_scheme_is_an_error() -> None:
    with pytest.raises(ConfigError, match="--mqtt is not an address"):
        MqttExporter("robby", "localhost")
