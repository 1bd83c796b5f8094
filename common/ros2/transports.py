"""Transports by name."""

from collections.abc import Callable

from common import registry
from common.extras import need
from common.ros2.config import Ros2Config
from common.ros2.transport import Ros2Transport

# Modules are imported on use, since each needs another library.
TRANSPORTS = {"zenoh": "common.ros2.rmw_zenoh:RmwZenoh", "dds": "common.ros2.dds:Dds"}


def find_transport(config: Ros2Config) -> type[Ros2Transport]:
    """Return the class of a transport; ConfigError if it is unknown, or its library is absent."""
    if config.transport == "dds":
        need("ROS 2 by DDS", "dds")
    found: type[Ros2Transport] = registry.find("transport", TRANSPORTS, config.transport)
    return found


def open_transport(config: Ros2Config) -> Ros2Transport:
    """Join the ROS 2 graph.

    ConfigError if a setting is invalid, or the transport's library is not installed; People4dError
    if no connection could be opened.
    """
    factory: Callable[[Ros2Config], Ros2Transport] = find_transport(config)
    return factory(config)
