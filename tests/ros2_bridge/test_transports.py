"""The bridge on each transport: all outputs at once, and people at another node."""

from typing import get_args

import pytest

from common.ros2 import types
from common.ros2.config import Ros2Config
from common.ros2.messages.people import PEOPLE
from common.ros2.transport import SENSOR_DATA, Ros2Sample
from common.ros2.transports import open_transport
from services.ros2_bridge.build import build
from services.ros2_bridge.config import Output, Ros2BridgeConfig
from tests.common.ros2.foreign import Received
from tests.network import Network
from tests.ros2_bridge.test_node import people, person

pytestmark = pytest.mark.network

DOMAIN = 83


@pytest.mark.parametrize("transport", ["zenoh", "dds"])
def test_people_reach_another_node(network: Network, transport: str) -> None:
    ros2 = Ros2Config(transport=transport, endpoints=(network.endpoint,), domain_id=DOMAIN)
    reader, received = open_transport(ros2), Received()

    def receive(sample: Ros2Sample) -> None:
        received(types.decode(PEOPLE, sample.cdr))

    reader.subscribe("/people", PEOPLE, receive, SENSOR_DATA)
    node = build(Ros2BridgeConfig(ros2=ros2, publish=get_args(Output)))
    message = received.wait(lambda: node.handle(people(person()), 0))
    assert message.people[0].tags[:2] == ["7", "-1"]
    counters = node.status().counters
    assert counters["ros2_sent"] > 0
    assert (counters["send_errors"], counters["ros2_unfit"]) == (0, 0)
    node.close()
    reader.close()
