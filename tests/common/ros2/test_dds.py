"""DDS against a participant with types of its own IDL, in a process of its own."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("cyclonedds")

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from common.ros2.config import Ros2Config
from common.ros2.dds import BINDING_LOCK, Dds
from common.ros2.dds_types import cdr_type
from common.ros2.transport import LATCHED, SENSOR_DATA, Ros2Sample, Ros2Transport
from common.ros2.types import decode, encode, type_hash
from people4d.errors import ConfigError
from tests.common.ros2.foreign import Received, until
from tests.common.ros2.idl import types as idl_types
from tests.common.ros2.idl.peer import structures
from tests.common.ros2.messages import filled, plain

pytestmark = [pytest.mark.network, pytest.mark.slow]

DOMAIN = 1 + os.getpid() % 90  # domain most likely unused by ROS 2 systems on this machine
NAMESPACE = f"/t{os.getpid()}"
RELIABLE = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.Durability.TransientLocal,
    Policy.History.KeepLast(10),
)
POINT = {"x": 1.0, "y": -2.0, "z": 3.5}


@pytest.fixture
def transport() -> Iterator[Ros2Transport]:
    """Node on the loopback interface."""
    transport = Dds(Ros2Config(transport="dds", domain_id=DOMAIN, namespace=NAMESPACE[1:]))
    yield transport
    transport.close()


@pytest.fixture
def foreign(transport: Ros2Transport) -> DomainParticipant:
    """Participant of another program in this process, which shares the domain's configuration."""
    with BINDING_LOCK:
        return DomainParticipant(DOMAIN)


def writer_of(foreign: DomainParticipant, topic: str, structure: Any, qos: Qos = RELIABLE) -> Any:
    """Return a publisher of another program."""
    with BINDING_LOCK:
        return DataWriter(foreign, Topic(foreign, f"rt{NAMESPACE}/{topic}", structure), qos=qos)


@pytest.mark.processes
def test_every_type_returns_from_a_foreign_participant_with_all_its_fields(
    transport: Ros2Transport,
) -> None:
    sent = {kind: filled(kind) for kind in structures() if "rmw_dds" not in kind}
    inboxes = {kind: Received() for kind in sent}
    for kind in sent:
        transport.subscribe(f"back/{kind.replace('/msg/', '_')}", kind, inboxes[kind], LATCHED)
    for kind, fields in sent.items():
        name = f"out/{kind.replace('/msg/', '_')}"
        transport.publisher(name, kind, LATCHED).send(encode(kind, fields))
    command = [sys.executable, "-m", "tests.common.ros2.idl.peer", str(DOMAIN), NAMESPACE]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as peer:
        assert peer.stdin
        assert peer.stdout
        assert peer.stdout.readline() == "ready\n"
        read = dict(json.loads(peer.stdout.readline()) for _ in sent)
        returned = {kind: inbox.wait() for kind, inbox in inboxes.items()}
        peer.stdin.close()
    assert read == sent
    assert {kind: plain(decode(kind, returned[kind].cdr)) for kind in sent} == sent
    assert all(sample.sent_ns > 0 for sample in returned.values())
    assert not +transport.counters


def test_node_and_topics_are_announced_as_ros_2_does(
    transport: Ros2Transport, foreign: DomainParticipant
) -> None:
    transport.publisher("people", "people_msgs/msg/People")
    transport.publisher("/tf_static", "tf2_msgs/msg/TFMessage", LATCHED)
    transport.subscribe("/odom", "nav_msgs/msg/Odometry", Received())
    with BINDING_LOCK:
        found = BuiltinDataReader(foreign, BuiltinTopicDcpsPublication).take(100)
    endpoints = {one.topic_name: one for one in found}
    people = endpoints[f"rt{NAMESPACE}/people"]
    assert people.type_name == "people_msgs::msg::dds_::People_"
    hashed = f"typehash={type_hash('people_msgs/msg/People')};"
    assert people.qos[Policy.Userdata].data == hashed.encode()
    assert endpoints["rt/tf_static"].qos[Policy.Durability] == Policy.Durability.TransientLocal

    structure = idl_types.ParticipantEntitiesInfo
    with BINDING_LOCK:
        graph = Topic(foreign, "ros_discovery_info", structure)
        (info,) = DataReader(foreign, graph, qos=RELIABLE).take(10)
    (node,) = info.node_entities_info_seq
    assert (node.node_namespace, node.node_name) == (NAMESPACE, "people4d")
    assert people.key.bytes in [bytes(gid.data) for gid in node.writer_gid_seq]
    assert (len(node.writer_gid_seq), len(node.reader_gid_seq)) == (2, 1)
    assert bytes(info.gid.data) == people.participant_key.bytes


def test_late_subscriber_gets_the_last_message_of_a_latched_topic_only(
    transport: Ros2Transport,
) -> None:
    latched, volatile = Received(), Received()
    publisher = transport.publisher("point", "geometry_msgs/msg/Point", LATCHED)
    for x in (1.0, 2.0):
        publisher.send(encode("geometry_msgs/msg/Point", POINT | {"x": x}))
    transport.subscribe("point", "geometry_msgs/msg/Point", volatile)
    transport.subscribe("point", "geometry_msgs/msg/Point", latched, LATCHED)
    assert latched.wait().cdr == encode("geometry_msgs/msg/Point", POINT | {"x": 2.0})
    publisher.send(encode("geometry_msgs/msg/Point", POINT | {"x": 3.0}))
    until(lambda: len(latched.messages) > 1)
    until(lambda: volatile.messages)


def test_bytes_that_are_no_message_are_refused_and_counted(transport: Ros2Transport) -> None:
    publisher = transport.publisher("image", "sensor_msgs/msg/Image")
    cdr = encode("sensor_msgs/msg/Image", filled("sensor_msgs/msg/Image"))
    for wrong in (b"", b"\0\1", b"\0\1\0\0" + b"\xff" * 40, cdr[:20]):
        publisher.send(wrong)
    assert transport.counters["send_errors"] == 4
    publisher.send(cdr)
    assert transport.counters["send_errors"] == 4


def test_publisher_of_another_structure_is_counted(
    transport: Ros2Transport, foreign: DomainParticipant
) -> None:
    received = Received()
    transport.subscribe("point", "geometry_msgs/msg/Point", received)
    writer = writer_of(foreign, "point", idl_types.Quaternion)
    writer.write(idl_types.Quaternion(1, 2, 3, 4))
    until(lambda: transport.counters["other_type"])
    assert not received.messages


def test_messages_of_another_type_hash_are_counted(
    transport: Ros2Transport, foreign: DomainParticipant
) -> None:
    received = Received()
    transport.subscribe("point", "geometry_msgs/msg/Point", received, LATCHED)
    old = Policy.Userdata(f"typehash=RIHS01_{'0' * 64};".encode())
    same = Policy.Userdata(f"typehash={type_hash('geometry_msgs/msg/Point')};".encode())
    wrong = writer_of(foreign, "point", idl_types.Point, Qos(old, base=RELIABLE))
    wrong.write(idl_types.Point(**POINT))
    until(lambda: transport.counters["other_type"] == 1)
    writer = writer_of(foreign, "point", idl_types.Point, Qos(same, base=RELIABLE))
    writer.write(idl_types.Point(**POINT))
    assert plain(decode("geometry_msgs/msg/Point", received.wait().cdr)) == POINT
    assert len(received.messages) == 1


def test_publisher_without_the_reliability_asked_for_is_counted(
    transport: Ros2Transport, foreign: DomainParticipant
) -> None:
    unreliable = Qos(Policy.Reliability.BestEffort)
    best = Received()
    transport.subscribe("point", "geometry_msgs/msg/Point", Received())
    transport.subscribe("point", "geometry_msgs/msg/Point", best, SENSOR_DATA)
    writer = writer_of(foreign, "point", idl_types.Point, unreliable)
    until(lambda: transport.counters["other_qos"] == 1)
    writer.write(idl_types.Point(**POINT))
    best.wait()


def test_receiver_that_raises_is_counted_and_receives_on(transport: Ros2Transport) -> None:
    received = Received()

    def receive(sample: Ros2Sample) -> None:
        received(sample)
        raise ZeroDivisionError

    transport.subscribe("point", "geometry_msgs/msg/Point", receive)
    publisher = transport.publisher("point", "geometry_msgs/msg/Point")
    for _ in range(3):
        publisher.send(encode("geometry_msgs/msg/Point", POINT))
    until(lambda: len(received.messages) == 3)
    until(lambda: transport.counters["receive_errors"] == 3)


def test_unknown_names_are_refused(transport: Ros2Transport) -> None:
    for topic in ("", "a b", "1st", "a//b", "people/"):
        with pytest.raises(ConfigError, match="ROS has no topic"):
            transport.publisher(topic, "people_msgs/msg/People")
    with pytest.raises(ConfigError, match="unknown"):
        transport.subscribe("people", "people_msgs/msg/Persons", Received())
    with pytest.raises(ConfigError, match="no DDS on interface 'nosuch'"):
        Dds(Ros2Config(transport="dds", domain_id=DOMAIN + 91, interface="nosuch"))


def test_structure_is_that_of_the_idl_compiler() -> None:
    for kind, structure in structures().items():
        ours: Any = cdr_type(kind)
        ours.__idl__.fill_type_data()
        structure.__idl__.fill_type_data()
        assert ours.__idl__.get_type_info() == structure.__idl__.get_type_info()
