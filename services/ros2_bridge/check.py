"""Check of the settings before the start."""

import msgspec

from common.ros2.names import resolve
from common.ros2.transports import find_transport
from services.ros2_bridge.config import Ros2BridgeConfig


def check_outputs(config: Ros2BridgeConfig) -> None:
    """Check the transport's library and the names of topics.

    Raises:
        ConfigError: A library is not installed, or ROS has no such name.
    """
    find_transport(config.ros2)
    for name, output in msgspec.structs.asdict(config.outputs).items():
        if name in config.publish:
            resolve(output.topic, config.ros2.namespace)
