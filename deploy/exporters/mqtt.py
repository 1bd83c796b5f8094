"""People and zones for an MQTT broker, announced to Home Assistant."""

import json
import logging
import re
import threading
import time
import zlib
from typing import Any

from common.io.plain_json import to_json
from common.runtime.monitor import FramePath
from deploy.exporters.measures import Exporter
from people4d.errors import People4dError
from people4d.messages import Message, Track, Tracks, Zone, Zones
from services.events.delivery import TIMEOUT_S
from services.events.mqtt import BrokerAddress
from services.events.rules import distance_inside

PERIOD_S = 1.0  # minimum time between messages of people [s]
EXPIRE_S = 15  # time without messages after which Home Assistant shows "unavailable" [s]
KEEP_ALIVE_S = 20  # interval of pings to the broker [s]
DISCOVERY = "homeassistant"
log = logging.getLogger("people4d")


class MqttExporter(Exporter):
    """Publishes people, their numbers in zones, and the entities of Home Assistant.

    ConfigError if the address is invalid; People4dError if the broker does not answer, or refuses
    the login.

    Args:
        robot: Name of the robot.
        url: Address of the broker; its topic, else people4d/<robot>, is the prefix of the topics.
    """

    def __init__(self, robot: str, url: str) -> None:
        super().__init__()
        address = BrokerAddress.parse(url, "--mqtt")
        self.topic = address.topic.rstrip("/") or f"people4d/{robot}"
        self._robot, self._node = robot, "people4d_" + re.sub("[^A-Za-z0-9_-]", "_", robot)
        self._zones: tuple[Zone, ...] = ()
        self._sent_s = -PERIOD_S
        self._answered, self._refusal = threading.Event(), ""
        self._client = address.client(f"people4d-export-{robot}")
        self._client.will_set(f"{self.topic}/status", "offline", qos=1, retain=True)
        self._client.on_connect = self._greet
        self._client.on_disconnect = self._report
        self._connect(address)

    def add_frame_path(self, path: FramePath) -> None:
        """Ignore the path of a frame."""

    def add_message(self, message: Message) -> None:
        """Publish people at a limited rate, and zones that changed."""
        if isinstance(message, Zones):
            removed = {_slug(zone) for zone in self._zones} - {_slug(z) for z in message.zones}
            self._zones = message.zones
            for slug in removed:
                for kind in ("sensor", "binary_sensor"):
                    self._client.publish(self._discovery_topic(kind, slug), b"", 1, retain=True)
            self._announce()
        elif isinstance(message, Tracks) and time.monotonic() - self._sent_s >= PERIOD_S:
            self._sent_s = time.monotonic()
            self._client.publish(f"{self.topic}/people", to_json(message, self._robot))
            tracked = [track for track in message.tracks if track.state != "tentative"]
            counts = {_slug(zone): _count(zone, tracked) for zone in self._zones}
            state = {"people": len(tracked), "zones": counts}
            self._client.publish(f"{self.topic}/state", json.dumps(state))

    def close(self) -> None:
        """Report offline, and disconnect."""
        sent = self._client.publish(f"{self.topic}/status", "offline", qos=1, retain=True)
        if self._client.is_connected():
            sent.wait_for_publish(TIMEOUT_S)
        self._client.disconnect()
        self._client.loop_stop()

    def _connect(self, address: BrokerAddress) -> None:
        where = f"the MQTT broker at {address.host}:{address.port}"
        try:
            self._client.connect(address.host, address.port, keepalive=KEEP_ALIVE_S)
        except OSError as error:
            raise People4dError(f"{where} does not answer: {error}", "Is it running?") from error
        self._client.loop_start()
        if not self._answered.wait(TIMEOUT_S) or self._refusal:
            self._client.disconnect()
            self._client.loop_stop()
            reason = self._refusal or f"no answer in {TIMEOUT_S:g} s"
            remedy = "The user is in the address, the password in PEOPLE4D_MQTT_PASSWORD."
            raise People4dError(f"{where} refuses: {reason}", remedy)

    def _greet(self, _client: Any, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        """Announce everything after each connection, since the broker may have restarted."""
        self._refusal = str(reason) if reason.is_failure else ""
        if not self._refusal:
            self._client.publish(f"{self.topic}/status", "online", qos=1, retain=True)
            self._announce()
        self._answered.set()

    def _report(self, _client: Any, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        if reason.is_failure:
            log.warning("connection to the MQTT broker lost (%s); it is tried again", reason)

    def _announce(self) -> None:
        """Publish the entities of Home Assistant."""
        self._entity("sensor", "people", "People", "value_json.people")
        for zone in self._zones:
            slug = _slug(zone)
            count = f"value_json.zones.{slug} | default(0)"
            self._entity("sensor", slug, f"{zone.name} people", count)
            occupied = f"'ON' if {count} > 0 else 'OFF'"
            self._entity("binary_sensor", slug, zone.name, occupied, device_class="occupancy")

    def _entity(self, kind: str, slug: str, name: str, value: str, **more: str) -> None:
        about = {
            "name": name,
            "unique_id": f"{self._node}_{kind}_{slug}",
            "state_topic": f"{self.topic}/state",
            "value_template": f"{{{{ {value} }}}}",
            "availability_topic": f"{self.topic}/status",
            "expire_after": EXPIRE_S,
            "device": {"identifiers": [self._node], "name": f"people4d {self._robot}"},
            **more,
        }
        topic = self._discovery_topic(kind, slug)
        self._client.publish(topic, json.dumps(about), qos=1, retain=True)

    def _discovery_topic(self, kind: str, slug: str) -> str:
        return f"{DISCOVERY}/{kind}/{self._node}/{slug}/config"


def _slug(zone: Zone) -> str:
    """Return a name for topics, since names of zones are any text."""
    return f"zone_{zlib.crc32(zone.name.encode()):08x}"


def _count(zone: Zone, tracks: list[Track]) -> int:
    return sum(distance_inside(zone.corners_m, track.position_m[:2]) > 0 for track in tracks)
