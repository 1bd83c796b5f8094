"""Connection to the ROS 2 nodes of a robot."""

from typing import Annotated, Literal

from msgspec import Meta

from common.config import Config


class Ros2Config(Config, frozen=True, kw_only=True):
    """Transport of ROS 2 topics, and the name of the node that they belong to."""

    # zenoh: nodes with RMW_IMPLEMENTATION=rmw_zenoh_cpp; dds: nodes with the other middlewares,
    # needs the extra dds; or module:Class of your own
    transport: str = "zenoh"
    domain_id: Annotated[int, Meta(ge=0, le=232)] = 0  # ROS_DOMAIN_ID of the nodes
    # release of ROS 2 of the nodes; Humble has no hashes of types
    distribution: Literal["humble", "iron", "jazzy", "kilted"] = "jazzy"
    # endpoints of the router that the nodes use (rmw_zenohd), for example tcp/192.168.1.5:7447;
    # empty: the robot's own router, which they can use, too. Not for dds
    endpoints: tuple[str, ...] = ()
    # network interface or address of DDS; the default stays on this machine
    interface: str = "127.0.0.1"
    node: str = "people4d"  # name of the node that ros2 node list shows
    namespace: str = ""  # before the node's name and relative topics, for example robot1
