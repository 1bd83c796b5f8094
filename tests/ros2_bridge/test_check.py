"""Settings of the bridge, checked before anything is started."""

import sys

import msgspec
import pytest

from common.ros2.config import Ros2Config
from people4d.errors import ConfigError
from services.ros2_bridge.check import check_outputs
from services.ros2_bridge.config import Ros2BridgeConfig


def test_shipped_settings_pass() -> None:
    check_outputs(Ros2BridgeConfig())


def test_name_that_ros_refuses_is_refused() -> None:
    outputs = {"people": {"topic": "/2d/people"}}
    config = msgspec.convert({"outputs": outputs}, Ros2BridgeConfig)
    with pytest.raises(ConfigError, match="2d/people"):
        check_outputs(config)


def test_unknown_transport_is_refused() -> None:
    with pytest.raises(ConfigError, match="zenoh, dds"):
        check_outputs(Ros2BridgeConfig(ros2=Ros2Config(transport="udp")))


def test_absent_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "common.ros2.dds", raising=False)
    monkeypatch.setitem(sys.modules, "cyclonedds", None)
    monkeypatch.setitem(sys.modules, "cyclonedds.builtin", None)
    with pytest.raises(ConfigError, match=r"people4d-robot\[dds\]"):
        check_outputs(Ros2BridgeConfig(ros2=Ros2Config(transport="dds")))
