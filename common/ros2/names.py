"""Names of ROS 2, and keys and liveliness tokens of rmw_zenoh.

Source: design document of rmw_zenoh (docs/design.md there).
"""

import re
from dataclasses import dataclass

from common.ros2 import types
from common.ros2.config import Ros2Config
from common.ros2.transport import Qos
from people4d.errors import ConfigError

TOKEN = r"[A-Za-z_][A-Za-z0-9_]*"
NAME = re.compile(rf"/?{TOKEN}(/{TOKEN})*")
MAX_NAME = 200
NO_HASH = "TypeHashNotSupported"  # value in rmw_zenoh's tokens for Humble
LIVELINESS = "@ros2_lv"


def resolve(topic: str, namespace: str = "") -> str:
    """Return the full name of a topic, "/" first.

    ConfigError if ROS has no such name.

    Args:
        topic: Name; without "/" in front it is relative to the namespace.
        namespace: Namespace of the node, with or without "/" in front; empty for none.
    """
    for what, name in (("topic", topic), ("namespace", namespace.strip("/"))):
        valid = NAME.fullmatch(name) and "__" not in name and len(name) <= MAX_NAME
        if not valid and (name or what == "topic"):
            raise ConfigError(
                f"ROS has no {what} {name!r:.80}",
                "Names are letters, digits and _, with / between; no part begins with a digit or "
                "holds two _ in a row.",
            )
    below = f"/{namespace.strip('/')}/" if namespace.strip("/") else "/"
    return topic if topic.startswith("/") else below + topic


@dataclass(frozen=True)
class TopicType:
    """Topic with its type, as named by the nodes of one release of ROS 2."""

    topic: str  # full name
    kind: str  # for example "std_msgs/msg/String"
    hash: str  # RIHS01, or NO_HASH

    @classmethod
    def from_names(cls, config: Ros2Config, topic: str, kind: str) -> "TopicType":
        """Return a topic of a node; ConfigError if its name or type is unknown."""
        known = types.type_hash(kind)
        hash_ = NO_HASH if config.distribution == "humble" else known
        return cls(resolve(topic, config.namespace), kind, hash_)

    def key(self, domain_id: int) -> str:
        """Return the key of its messages in rmw_zenoh."""
        return f"{domain_id}{self.topic}/{types.dds_name(self.kind)}/{self.hash}"


@dataclass(frozen=True)
class NodeTokens:
    """Liveliness tokens of rmw_zenoh, which announce nodes and topics."""

    domain_id: int
    session: str  # identity of the Zenoh session
    namespace: str  # namespace of the node; empty for none
    node: str

    def of_node(self) -> str:
        """Return the key of the node's token."""
        return self._token(0, "NN")

    def of_publisher(self, number: int, topic: TopicType, qos: Qos) -> str:
        """Return the key of a publisher's token; numbers from 1 are unique in a session."""
        return self._token(number, "MP") + _ending(topic, qos)

    def of_subscription(self, number: int, topic: TopicType, qos: Qos) -> str:
        """Return the key of a subscription's token."""
        return self._token(number, "MS") + _ending(topic, qos)

    def _token(self, number: int, kind: str) -> str:
        # A session has one node (number 0), without a security enclave ("%").
        namespace = _mangle(f"/{self.namespace.strip('/')}")
        return (
            f"{LIVELINESS}/{self.domain_id}/{self.session}/0/{number}/{kind}/%/{namespace}/"
            f"{self.node}"
        )


def _ending(topic: TopicType, qos: Qos) -> str:
    kind = types.dds_name(topic.kind)
    return f"/{_mangle(topic.topic)}/{kind}/{topic.hash}/{qos_text(qos)}"


def _mangle(name: str) -> str:
    return name.replace("/", "%")


def qos_text(qos: Qos) -> str:
    """Return a quality of service as in tokens: numbers of rmw, empty for defaults."""
    reliability = 1 if qos.reliability == "reliable" else 2
    durability = 1 if qos.durability == "transient_local" else 2
    return f"{reliability}:{durability}:1,{qos.depth}:,:,:,,"
