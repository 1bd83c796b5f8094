"""Build the node of the service from its configuration."""

from common.ros2.transports import open_transport
from common.runtime.node import Node
from services.ros2_bridge.config import Ros2BridgeConfig
from services.ros2_bridge.node import Ros2BridgeNode


def build(config: Ros2BridgeConfig) -> Node:
    """Join the ROS 2 graph and make the node."""
    transport = open_transport(config.ros2)
    try:
        return Ros2BridgeNode(config, transport)
    except BaseException:
        transport.close()
        raise
