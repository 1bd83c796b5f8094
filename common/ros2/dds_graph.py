"""Announcement of a node on DDS, for `ros2 node list` and `ros2 node info`."""

from typing import Any, Literal

from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from common.ros2.config import Ros2Config
from common.ros2.dds_types import cdr_type
from common.ros2.types import Fields, encode

TOPIC = "ros_discovery_info"
KIND = "rmw_dds_common/msg/ParticipantEntitiesInfo"


class DdsGraph:
    """Announces a node with its publishers and subscriptions.

    Humble has another definition of the message: it shows the topics without a node.
    """

    def __init__(self, participant: Any, config: Ros2Config) -> None:
        self._gid = _gid(participant)
        self._namespace = f"/{config.namespace}" if config.namespace else "/"
        self._node = config.node
        self._gids: dict[str, list[Fields]] = {"reader_gid_seq": [], "writer_gid_seq": []}
        self._announcer: Any = None
        if config.distribution == "humble":
            return
        qos = Qos(
            Policy.Reliability.Reliable(duration(seconds=1)),
            Policy.Durability.TransientLocal,
            Policy.History.KeepLast(1),
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )
        self._announcer = DataWriter(participant, Topic(participant, TOPIC, cdr_type(KIND)), qos)
        self._send()

    def announce(self, role: Literal["reader", "writer"], entity: Any) -> None:
        """Announce a subscription or publisher."""
        self._gids[f"{role}_gid_seq"].append(_gid(entity))
        self._send()

    def close(self) -> None:
        """Withdraw the node."""
        self._announcer = None

    def _send(self) -> None:
        if self._announcer is None:
            return
        node = {"node_namespace": self._namespace, "node_name": self._node, **self._gids}
        message = {"gid": self._gid, "node_entities_info_seq": [node]}
        self._announcer.write(cdr_type(KIND)(encode(KIND, message)))


def _gid(entity: Any) -> Fields:
    return {"data": list(entity.guid.bytes)}
