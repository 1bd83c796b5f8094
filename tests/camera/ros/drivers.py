"""Drivers of other programs that publish a camera: zenoh-ros2-sdk, and DDS with its own types."""

import dataclasses
from pathlib import Path
from typing import Any, Protocol

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from zenoh_ros2_sdk import ROS2Publisher
from zenoh_ros2_sdk.qos import QosDurability, QosProfile

from common.ros2.dds import BINDING_LOCK
from tests.common.ros2.foreign import Sdk
from tests.common.ros2.idl.peer import structures
from tests.common.ros2.messages import plain

LATCHED = ("/tf_static",)


class CameraDriver(Protocol):
    """Publishes messages that are given as rosbags makes them."""

    def publish(self, topic: str, message: Any) -> None:
        """Publish a message; the type is its own."""

    def close(self) -> None:
        """Leave the network."""


class SdkDriver:
    """On Zenoh as rmw_zenoh, by zenoh-ros2-sdk."""

    def __init__(self, endpoint: str, folder: Path) -> None:
        self._sdk = Sdk(endpoint, folder)
        self._publishers: dict[str, Any] = {}

    def publish(self, topic: str, message: Any) -> None:
        kind = message.__msgtype__
        if topic not in self._publishers:
            definition = self._sdk.learn(kind)
            qos = QosProfile(durability=QosDurability.TRANSIENT_LOCAL) if topic in LATCHED else None
            where = self._sdk.where
            self._publishers[topic] = ROS2Publisher(topic, kind, definition, qos=qos, **where)
        names = [field.name for field in dataclasses.fields(message) if field.init]
        values = {name: self._own(getattr(message, name)) for name in names}
        self._publishers[topic].publish(**values)

    def close(self) -> None:
        for publisher in self._publishers.values():
            publisher.close()
        self._sdk.close()

    def _own(self, value: Any) -> Any:
        """Return a message as one of the classes of the SDK."""
        if isinstance(value, list):
            return [self._own(item) for item in value]
        if not dataclasses.is_dataclass(value):
            return value
        kind: Any = value
        names = [field.name for field in dataclasses.fields(value) if field.init]
        made = self._sdk.session.store.types[kind.__msgtype__]
        return made(**{name: self._own(getattr(value, name)) for name in names})


class DdsDriver:
    """On DDS, by classes that the IDL compiler made."""

    def __init__(self, domain: int) -> None:
        with BINDING_LOCK:
            self._participant = DomainParticipant(domain)
        self._writers: dict[str, Any] = {}

    def publish(self, topic: str, message: Any) -> None:
        structure = structures()[message.__msgtype__]
        if topic not in self._writers:
            latched = topic in LATCHED
            qos = Qos(
                Policy.Reliability.Reliable(duration(seconds=1)),
                Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
                Policy.History.KeepLast(10),
            )
            with BINDING_LOCK:
                entity = Topic(self._participant, f"rt{topic}", structure)
                self._writers[topic] = DataWriter(self._participant, entity, qos=qos)
        self._writers[topic].write(_made(structure, plain(message)))

    def close(self) -> None:
        self._writers.clear()


def _made(structure: Any, value: Any) -> Any:
    """Return an object of a class of the IDL compiler from plain values."""
    fields = {}
    for field in dataclasses.fields(structure):
        kind, given = field.type, value[field.name]
        inner = getattr(kind, "__metadata__", (None,))[0]
        element = getattr(inner, "subtype", None)
        if dataclasses.is_dataclass(kind):
            fields[field.name] = _made(kind, given)
        elif dataclasses.is_dataclass(element):
            fields[field.name] = [_made(element, item) for item in given]
        else:
            fields[field.name] = given
    return structure(**fields)
