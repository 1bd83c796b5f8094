"""Names and keys of ROS 2, compared with pamoja-ros2."""

import pytest
from pamoja import ros2 as pamoja

from common.ros2.config import Ros2Config
from common.ros2.names import NodeTokens, TopicType, qos_text, resolve
from common.ros2.transport import LATCHED, SENSOR_DATA
from people4d.errors import ConfigError

NAMES = ("people", "/people", "/a/b_c/d1", "", "/", "2d", "a//b", "a/", "a__b", "a b", "/ä", "~x")


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_refused_where_pamoja_refuses_it(name: str) -> None:
    valid = pamoja.is_valid_name(name) and not name.startswith("~")
    if valid:
        assert resolve(name).endswith(name)
    else:
        with pytest.raises(ConfigError):
            resolve(name)


def test_relative_name_is_below_the_namespace() -> None:
    assert resolve("people", "/robot1/") == "/robot1/people"
    assert resolve("/people", "robot1") == "/people"
    with pytest.raises(ConfigError, match="namespace"):
        resolve("people", "robot 1")


def test_key_is_that_of_pamoja() -> None:
    named = TopicType.from_names(Ros2Config(namespace="a"), "tf", "tf2_msgs/msg/TFMessage")
    assert named.key(7) == pamoja.entity_key(7, "/a/tf", "tf2_msgs/msg/TFMessage", named.hash)


def test_unknown_type_is_refused() -> None:
    with pytest.raises(ConfigError, match="unknown"):
        TopicType.from_names(Ros2Config(), "tf", "tf2_msgs/msg/Other")


def test_token_of_a_publisher() -> None:
    topic = TopicType("/a/tf", "std_msgs/msg/String", "RIHS01_00")
    tokens = NodeTokens(3, "0f", "/a", "node")
    assert tokens.of_node() == "@ros2_lv/3/0f/0/0/NN/%/%a/node"
    ending = f"{pamoja.percent_mangle('/a/tf')}/std_msgs::msg::dds_::String_/RIHS01_00"
    expected = f"@ros2_lv/3/0f/0/2/MP/%/%a/node/{ending}/1:1:1,1:,:,:,,"
    assert tokens.of_publisher(2, topic, LATCHED) == expected
    assert qos_text(SENSOR_DATA) == "2:2:1,5:,:,:,,"
