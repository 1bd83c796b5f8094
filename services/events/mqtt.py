"""MQTT broker as a receiver of events, and its address and client for other senders."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote, urlsplit

from common.extras import need
from people4d.errors import ConfigError
from people4d.messages import Event
from services.events.config import EventsConfig
from services.events.delivery import TIMEOUT_S

PASSWORD = "PEOPLE4D_MQTT_PASSWORD"  # name of the environment variable
PORTS = {"mqtt": 1883, "mqtts": 8883}
EXAMPLE = "mqtt://192.168.1.9/robots/events"
NO_KEEP_ALIVE = 0  # keep-alive interval: no pings between events [s]


@dataclass(frozen=True)
class BrokerAddress:
    """Address mqtt://[user@]host[:port][/topic], or mqtts for TLS.

    TLS uses the certificates of the system; the user's password is in PEOPLE4D_MQTT_PASSWORD.
    """

    host: str
    port: int
    user: str  # user name; empty: no login
    tls: bool
    topic: str  # topic of events; empty: default

    @classmethod
    def parse(cls, text: str, setting: str) -> "BrokerAddress":
        """Parse the address in a setting; ConfigError if it is invalid."""
        parts = urlsplit(text)
        try:
            port = parts.port
        except ValueError:
            port = -1
        topic = unquote(parts.path.lstrip("/"))
        wrong = parts.scheme not in PORTS or not parts.hostname or port == -1
        if wrong or parts.query or "#" in text or "#" in topic or "+" in topic:
            raise ConfigError(f"{setting} is not an address: {text!r}", f"Write: {EXAMPLE}.")
        user, tls = unquote(parts.username or ""), parts.scheme == "mqtts"
        return cls(str(parts.hostname), port or PORTS[parts.scheme], user, tls, topic)

    def client(self, name: str) -> Any:
        """Return an unconnected client of paho-mqtt with this login."""
        from paho.mqtt.client import Client  # noqa: PLC0415  # an extra
        from paho.mqtt.enums import CallbackAPIVersion  # noqa: PLC0415

        made: Any = Client(CallbackAPIVersion.VERSION2, name)
        made.connect_timeout = TIMEOUT_S
        if self.user:
            made.username_pw_set(self.user, os.environ.get(PASSWORD))
        if self.tls:
            made.tls_set()
        return made


class MqttBroker:
    """Receiver of events by MQTT 3.1.1 with quality of service 1.

    Args:
        address: Address of the broker; without a topic people4d/<robot>/events.
        robot: Name of the robot.

    Raises:
        ConfigError: The address is invalid, or paho-mqtt is not installed.
    """

    name = "mqtt"

    def __init__(self, address: str, robot: str) -> None:
        need("events.mqtt", "mqtt")
        from paho.mqtt import client  # noqa: PLC0415  # an extra

        self._error_text: Callable[[Any], str] = client.error_string
        self._address = BrokerAddress.parse(address, "events.mqtt")
        self._topic = self._address.topic or f"people4d/{robot}/events"
        self._id = f"people4d-{robot}"
        self._client: Any = None

    def send(self, event: Event, body: bytes) -> None:  # noqa: ARG002
        """Publish an event; OSError unless the broker acknowledges it in time."""
        if self._client and self._client.loop(0):  # the broker has closed the connection
            self.close()
        self._client = self._client or self._connected()
        try:
            sent = self._client.publish(self._topic, body, qos=1)
            self._await(self._client, sent.is_published, "acknowledgement")
        except Exception:  # an open connection would repeat the event
            self.close()
            raise

    def close(self) -> None:
        """Close the connection."""
        if self._client:
            self._client.disconnect()
            self._client = None

    def _connected(self) -> Any:
        client = self._address.client(self._id)
        answers: list[Any] = []

        def answer(_client: Any, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
            answers.append(reason)

        client.on_connect = answer
        client.connect(self._address.host, self._address.port, keepalive=NO_KEEP_ALIVE)
        self._await(client, lambda: answers, "answer")
        if answers[0].is_failure:
            raise OSError(f"refused: {answers[0]}")
        return client

    def _await(self, client: Any, came: Callable[[], object], what: str) -> None:
        """Receive in this thread until `came`; bad input cannot break another thread."""
        end_s = time.monotonic() + TIMEOUT_S
        while not came():
            left_s = end_s - time.monotonic()
            if left_s <= 0:
                raise OSError(f"no {what} within {TIMEOUT_S:g} s")
            failure = client.loop(left_s)
            if failure and not came():
                raise OSError(self._error_text(failure))


def check_broker(config: EventsConfig) -> None:
    """Check that the MQTT client is installed if a broker is set; ConfigError otherwise."""
    if config.mqtt:
        need("events.mqtt", "mqtt")
