"""Connection to the ROS 2 nodes of a robot."""

from typing import Annotated, Literal

from msgspec import Meta

from common.config import Config


class Ros2Config(Config, frozen=True, kw_only=True):
    """Transport of ROS 2 topics, and the name of their node."""

    # zenoh: nodes with RMW_IMPLEMENTATION=rmw_zenoh_cpp; dds: nodes with other middlewares (extra
    # dds); or module:Class of your own
    transport: str = "zenoh"
    domain_id: Annotated[int, Meta(ge=0, le=232)] = 0  # ROS_DOMAIN_ID of the nodes
    # ROS 2 release of the nodes; Humble has no type hashes
    distribution: Literal["humble", "iron", "jazzy", "kilted", "lyrical"] = "jazzy"
    # endpoints of the nodes' router (rmw_zenohd), for example tcp/192.168.1.5:7447; empty: the
    # robot's own router. Not for dds
    endpoints: tuple[str, ...] = ()
    # network interface or address of DDS; default: loopback
    interface: str = "127.0.0.1"
    node: str = "people4d"  # name of the node
    namespace: str = ""  # namespace of the node and its relative topics, for example robot1
