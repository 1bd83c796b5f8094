"""Topics as zenoh-bridge-ros2dds forwards them, with sessions of Zenoh itself."""

from collections.abc import Iterator

import pytest

from common.ros2 import types
from common.ros2.config import Ros2Config
from common.ros2.ros2dds import Ros2Dds
from common.ros2.transport import DEFAULT, LATCHED, Ros2Sample
from tests.common.ros2.foreign import Received, raw_session, until
from tests.network import Network

pytestmark = pytest.mark.network

TEXT = "std_msgs/msg/String"


@pytest.fixture
def node(network: Network) -> Iterator[Ros2Dds]:
    transport = Ros2Dds(Ros2Config(endpoints=(network.endpoint,), namespace="robot1"))
    yield transport
    transport.close()


def test_key_is_the_topic_without_its_slash(network: Network, node: Ros2Dds) -> None:
    heard, cdr = Received(), types.encode(TEXT, {"data": "here"})
    publisher = node.publisher("people", TEXT)
    with raw_session(network.endpoint) as session:
        session.declare_subscriber("robot1/people", heard)
        sample = heard.wait(lambda: publisher.send(cdr))
    assert (sample.payload.to_bytes(), sample.attachment) == (cdr, None)


def test_message_is_received_and_a_bad_one_counted(network: Network, node: Ros2Dds) -> None:
    received = Received()

    def receive(sample: Ros2Sample) -> None:
        received(types.decode(TEXT, sample.cdr).data)

    node.subscribe("/chatter", TEXT, receive)
    with raw_session(network.endpoint) as session:
        until(lambda: node.counters["bad_message"], lambda: session.put("chatter", b""))
        session.put("chatter", types.encode(TEXT, {"data": "here"}))
        assert received.wait() == "here"


def test_topics_are_announced_as_other_bridges_read_them(network: Network, node: Ros2Dds) -> None:
    node.publisher("/tf_static", TEXT, LATCHED)
    node.subscribe("/a/b", TEXT, lambda _: None, DEFAULT)
    tokens = {
        "/MP/tf_static/std_msgs§msg§String/:1:1:0,1",
        "/MS/a§b/std_msgs§msg§String/:1:0:0,10",
        "",
    }

    with raw_session(network.endpoint) as session:

        def announced() -> set[str]:
            replies = session.liveliness().get("@/*/@ros2_lv/**", timeout=2.0)
            keys = (str(reply.ok.key_expr) for reply in replies if reply.ok)
            return {key.partition("@ros2_lv")[2] for key in keys}

        until(lambda: announced() >= tokens)


def test_late_session_gets_the_last_latched_message(network: Network, node: Ros2Dds) -> None:
    publisher = node.publisher("/tf_static", TEXT, LATCHED)
    for text in ("first", "last"):
        publisher.send(types.encode(TEXT, {"data": text}))
    late, received = Ros2Dds(Ros2Config(endpoints=(network.endpoint,))), Received()
    late.subscribe("/tf_static", TEXT, received, LATCHED)
    assert types.decode(TEXT, received.wait().cdr).data == "last"
    late.close()
