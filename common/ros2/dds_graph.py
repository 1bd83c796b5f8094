"""The node of a DDS participant, for `ros2 node list` and `ros2 node info`."""

from typing import Any

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
    """Announces a node with its publishers and subscriptions; not to Humble.

    Humble defines the message differently, and shows the topics without the node.
    """

    def __init__(self, participant: Any, config: Ros2Config) -> None:
        self._gid = _gid(participant)
        self._namespace = f"/{config.namespace}" if config.namespace else "/"
        self._node = config.node
        self._readers: list[Fields] = []
        self._writers: list[Fields] = []
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
        self._announce()

    def add_reader(self, reader: Any) -> None:
        """Announce a subscription."""
        self._readers.append(_gid(reader))
        self._announce()

    def add_writer(self, writer: Any) -> None:
        """Announce a publisher."""
        self._writers.append(_gid(writer))
        self._announce()

    def remove_writer(self, writer: Any) -> None:
        """Withdraw a publisher."""
        self._writers.remove(_gid(writer))
        self._announce()

    def close(self) -> None:
        """Withdraw the node."""
        self._announcer = None

    def _announce(self) -> None:
        if self._announcer is None:
            return
        node = {
            "node_namespace": self._namespace,
            "node_name": self._node,
            "reader_gid_seq": self._readers,
            "writer_gid_seq": self._writers,
        }
        message = {"gid": self._gid, "node_entities_info_seq": [node]}
        self._announcer.write(cdr_type(KIND)(encode(KIND, message)))


def _gid(entity: Any) -> Fields:
    return {"data": list(entity.guid.bytes)}
