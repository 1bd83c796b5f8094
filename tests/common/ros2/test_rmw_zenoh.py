"""Topics of rmw_zenoh with third-party clients, on the loopback interface."""

import struct
from collections.abc import Iterator

import pytest
from pamoja import ros2 as pamoja
from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber, discovery
from zenoh_ros2_sdk.discovery import TopicInfo
from zenoh_ros2_sdk.qos import QosDurability, QosProfile
from zenoh_ros2_sdk.utils import get_type_hash, load_dependencies_recursive

from common.ros2 import types
from common.ros2.config import Ros2Config
from common.ros2.messages import basic, boxes, health, hri, markers, people
from common.ros2.names import NO_HASH, TopicType
from common.ros2.rmw_zenoh import ATTACHMENT, RmwZenoh
from common.ros2.transport import LATCHED, SENSOR_DATA, Ros2Sample
from people4d.errors import ConfigError
from tests.common.ros2.foreign import Received, Sdk, raw_session, until
from tests.common.ros2.messages import filled, plain
from tests.network import Network

pytestmark = pytest.mark.network

# What the bridge publishes.
PUBLISHED = (
    *(people.PEOPLE, people.PEDESTRIANS, people.AGENTS, people.PERSONS, boxes.DETECTIONS),
    *(markers.MARKERS, hri.IDS, hri.REGION, hri.SKELETON, hri.TEXT),
    *(basic.ODOMETRY, basic.TF, health.DIAGNOSTICS),
)
PEOPLE = people.PEOPLE
TWIST = "geometry_msgs/msg/Twist"
FIELDS = {
    "header": {"stamp": {"sec": 3, "nanosec": 7}, "frame_id": "map"},
    "people": [{"name": "4", "position": {"x": 1.5}, "tags": ["4", "-1"]}],
}


@pytest.fixture(scope="module")
def sdk(network: Network, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Sdk]:
    client = Sdk(network.endpoint, tmp_path_factory.mktemp("definitions"))
    yield client
    client.close()


@pytest.fixture
def node(network: Network) -> Iterator[RmwZenoh]:
    transport = RmwZenoh(Ros2Config(endpoints=(network.endpoint,), node="tested"))
    yield transport
    transport.close()


def test_sdk_receives_what_is_published(sdk: Sdk, node: RmwZenoh) -> None:
    received = Received()
    definition = sdk.learn(PEOPLE)
    subscriber = ROS2Subscriber("/people", PEOPLE, received, definition, **sdk.where)
    publisher = node.publisher("/people", PEOPLE)
    message = received.wait(lambda: publisher.send(types.encode(PEOPLE, FIELDS)))
    assert (message.header.stamp.sec, message.header.frame_id) == (3, "map")
    assert (message.people[0].position.x, message.people[0].tags) == (1.5, ["4", "-1"])
    subscriber.close()


def test_message_of_sdk_is_received_with_its_time(sdk: Sdk, node: RmwZenoh) -> None:
    received = Received()
    definition = sdk.learn(TWIST)
    node.subscribe("cmd_vel", TWIST, received, SENSOR_DATA)
    publisher = ROS2Publisher("/cmd_vel", TWIST, definition, **sdk.where)
    vector = sdk.session.store.types["geometry_msgs/msg/Vector3"]
    linear, angular = vector(x=0.5, y=0.0, z=0.0), vector(x=0.0, y=0.0, z=-0.25)
    sample = received.wait(lambda: publisher.publish(linear=linear, angular=angular))
    message = types.decode(TWIST, sample.cdr)
    assert (message.linear.x, message.angular.z) == (0.5, -0.25)
    assert sample.sent_ns > 1e18
    publisher.close()


def test_sdk_lists_topic_node_type_and_quality(sdk: Sdk, node: RmwZenoh) -> None:
    found: list[TopicInfo] = []

    def complete() -> bool:
        # The SDK waits half a second for the answer, which a loaded machine may miss.
        info = discovery.get_topic_info("/listed", verbose=True, **sdk.where)
        found[:] = [info] if info else []
        return info is not None and (info.publisher_count, info.subscriber_count) == (1, 1)

    node.publisher("/listed", PEOPLE, LATCHED)
    node.subscribe("/listed", PEOPLE, lambda _: None, SENSOR_DATA)
    until(lambda: ("/listed", [PEOPLE]) in discovery.get_topic_names_and_types(**sdk.where))
    until(complete)
    (publisher,) = found[0].publishers
    assert (publisher.node_name, publisher.type_hash) == ("tested", types.type_hash(PEOPLE))
    quality = QosProfile.decode(publisher.qos)
    assert (quality.durability, quality.history_depth) == (QosDurability.TRANSIENT_LOCAL, 1)


def test_topic_vanishes_with_its_publisher(sdk: Sdk, node: RmwZenoh) -> None:
    def listed() -> bool:
        return "/left" in dict(discovery.get_topic_names_and_types(**sdk.where))

    publisher = node.publisher("/left", PEOPLE)
    until(listed)
    publisher.close()
    until(lambda: not listed())


def test_router_that_restricts_access_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PEOPLE4D_KEYS", "/keys")
    with pytest.raises(ConfigError, match="roles"):
        RmwZenoh(Ros2Config())


def test_late_sdk_gets_the_last_latched_message(sdk: Sdk, node: RmwZenoh) -> None:
    definition = sdk.learn(PEOPLE)
    publisher = node.publisher("/latched", PEOPLE, LATCHED)
    publisher.send(types.encode(PEOPLE, {}))
    publisher.send(types.encode(PEOPLE, FIELDS))
    received = Received()
    quality = QosProfile(durability=QosDurability.TRANSIENT_LOCAL)

    def join() -> None:
        # The SDK asks for publishers once, and a peer of Zenoh finds none in its first second.
        ROS2Subscriber("/latched", PEOPLE, received, definition, qos=quality, **sdk.where).close()

    assert received.wait(join).header.frame_id == "map"


def test_late_node_gets_the_last_latched_message(network: Network, node: RmwZenoh) -> None:
    publisher = node.publisher("/tf_static", PEOPLE, LATCHED)
    publisher.send(types.encode(PEOPLE, FIELDS))
    received = Received()
    late = RmwZenoh(Ros2Config(endpoints=(network.endpoint,)))
    late.subscribe("/tf_static", PEOPLE, received, LATCHED)
    assert received.wait().cdr == types.encode(PEOPLE, FIELDS)
    late.close()


def test_client_with_keys_and_numbers_of_pamoja(network: Network, node: RmwZenoh) -> None:
    key = pamoja.entity_key(0, "/robot1/cmd_vel", TWIST, types.type_hash(TWIST))
    assert key is not None
    received = Received()
    node.subscribe("/robot1/cmd_vel", TWIST, received)
    publisher = node.publisher("/robot1/cmd_vel", TWIST)
    heard = Received()
    with raw_session(network.endpoint) as session:
        subscriber = session.declare_subscriber(key, heard)
        cdr = types.encode(TWIST, {"linear": {"x": 0.5}, "angular": {"z": -0.25}})
        sample = heard.wait(lambda: publisher.send(cdr))
        linear, angular = pamoja.twist_from_cdr(list(sample.payload.to_bytes())) or ((), ())
        assert (linear, angular) == ((0.5, 0.0, 0.0), (0.0, 0.0, -0.25))
        attachment = sample.attachment.to_bytes()
        assert (len(attachment), attachment[16]) == (33, 16)
        theirs = bytes(pamoja.twist_to_cdr((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)))
        session.put(key, theirs, attachment=struct.pack("<qqB", 1, 42, 16) + bytes(16))
        assert received.wait() == Ros2Sample(theirs, 42)
        subscriber.undeclare()  # type: ignore[no-untyped-call]
    assert types.decode(TWIST, theirs).angular.y == 5.0


def test_bad_messages_are_counted(network: Network, node: RmwZenoh) -> None:
    received = Received()

    def receive(sample: Ros2Sample) -> None:
        received(types.decode(TWIST, sample.cdr))

    def fail(_: Ros2Sample) -> None:
        raise RuntimeError

    node.subscribe("/bad", TWIST, receive)
    node.subscribe("/broken", TWIST, fail)
    key = TopicType("/bad", TWIST, types.type_hash(TWIST)).key(0)
    cdr, attachment = types.encode(TWIST, {}), ATTACHMENT.pack(1, 2, 16, bytes(16))
    with raw_session(network.endpoint) as session:

        def send() -> None:
            session.put(key, cdr)
            session.put(key, cdr, attachment=attachment[:-1])
            session.put(key, cdr[:-1], attachment=attachment)
            session.put(key[:-1] + "x", cdr, attachment=attachment)
            session.put(key.replace("Twist", "Wrench"), cdr, attachment=attachment)
            session.put(key.replace("/bad/", "/broken/"), cdr, attachment=attachment)

        until(lambda: node.counters["receive_errors"], send)
        until(lambda: node.counters["bad_message"] >= 1)
        assert node.counters["no_attachment"] >= 2
        assert node.counters["other_type"] >= 2
        assert not received.messages
        session.put(key, cdr, attachment=attachment)
        received.wait()


def test_nodes_of_humble_have_no_hashes(network: Network) -> None:
    humble = RmwZenoh(Ros2Config(endpoints=(network.endpoint,), distribution="humble"))
    publisher, heard = humble.publisher("/people", PEOPLE), Received()
    with raw_session(network.endpoint) as session:
        session.declare_subscriber(f"0/people/people_msgs::msg::dds_::People_/{NO_HASH}", heard)
        heard.wait(lambda: publisher.send(types.encode(PEOPLE, FIELDS)))
    humble.close()


def test_closed_session_counts_what_it_cannot_send(network: Network) -> None:
    transport = RmwZenoh(Ros2Config(endpoints=(network.endpoint,)))
    publisher = transport.publisher("/people", PEOPLE)
    transport.close()
    publisher.send(b"")
    assert transport.counters["send_errors"] == 1


@pytest.fixture(scope="module")
def shared_node(network: Network) -> Iterator[RmwZenoh]:
    transport = RmwZenoh(Ros2Config(endpoints=(network.endpoint,)))
    yield transport
    transport.close()


@pytest.mark.parametrize("kind", PUBLISHED)
def test_every_field_arrives_as_sent(sdk: Sdk, shared_node: RmwZenoh, kind: str) -> None:
    definition, topic = sdk.learn(kind), f"/{kind.rpartition('/')[2]}"
    cdr = types.encode(kind, filled(kind))
    expected = plain(types.make(kind, filled(kind)))
    theirs, ours = Received(), Received()
    subscriber = ROS2Subscriber(f"{topic}/out", kind, theirs, definition, **sdk.where)
    publisher = shared_node.publisher(f"{topic}/out", kind)
    assert plain(theirs.wait(lambda: publisher.send(cdr))) == expected
    subscriber.close()
    shared_node.subscribe(f"{topic}/in", kind, ours)
    message = sdk.session.store.deserialize_cdr(cdr, kind)
    fields = {name: getattr(message, name) for name in expected}
    sender = ROS2Publisher(f"{topic}/in", kind, definition, **sdk.where)
    sample = ours.wait(lambda: sender.publish(**fields))
    assert plain(types.decode(kind, sample.cdr)) == expected
    assert sample.cdr == cdr
    sender.close()


@pytest.mark.parametrize("kind", sorted({*types.definitions(), *PUBLISHED}))
def test_hash_of_type_is_that_of_the_sdk(sdk: Sdk, kind: str) -> None:
    definition = sdk.learn(kind)
    inner = load_dependencies_recursive(kind, definition, sdk.registry)
    assert types.type_hash(kind) == get_type_hash(kind, definition, inner)
    assert pamoja.type_hash_digest(types.type_hash(kind)) is not None
