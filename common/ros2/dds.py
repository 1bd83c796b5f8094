"""ROS 2 topics on DDS by Cyclone DDS, without bridge or router."""

import os
import re
import threading
from collections import Counter
from ipaddress import ip_address
from typing import Any
from weakref import WeakValueDictionary
from xml.sax.saxutils import quoteattr

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import (
    DDSException,
    DDSStatus,
    GuardCondition,
    InstanceState,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy
from cyclonedds.qos import Qos as Policies
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from common.ros2.config import Ros2Config
from common.ros2.dds_graph import DdsGraph
from common.ros2.dds_types import CdrSample, cdr_type
from common.ros2.names import resolve
from common.ros2.transport import DEFAULT, Qos, Receive, Ros2Publisher, Ros2Sample, Ros2Transport
from common.ros2.types import dds_name, type_hash
from people4d.errors import ConfigError

BLOCK_S = 0.1  # maximum wait of a reliable publisher for a slow subscriber [s]
CLOSE_S = 2.0  # maximum wait for the end of a subscription [s]
UNLIMITED = -1
NEW = ViewState.Any | InstanceState.Alive | SampleState.NotRead
MAX_PUBLISHERS = 1000  # maximum number of publishers read at once
# Type hash in the user data of ROS 2's publishers
TYPE_HASH = re.compile(rb"typehash=(RIHS\d+_[0-9a-f]+);")
TYPE_CONSISTENCY = 24  # number of the policy in DDS-XTypes
# Unicast to the first participants on this machine, as in ROS 2 with local discovery.
LOCAL_DISCOVERY = (
    "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
    '<Peers><Peer address="localhost"/></Peers></Discovery>'
)

# The binding converts policies in buffers shared by all threads of the process. Without this lock
# it crashes if two subscriptions read publishers at once. All other calls of the binding with a QoS
# must hold it, too.
BINDING_LOCK = threading.RLock()

# Domains with their configuration, shared by all participants of the process.
_domains: WeakValueDictionary[tuple[int, str], Domain] = WeakValueDictionary()


class Dds(Ros2Transport):
    """Participant of DDS with the name of a node; loopback only unless configured.

    Publishers carry the hash of their type as in ROS 2 since Iron. Messages of a publisher with
    another hash are dropped. $CYCLONEDDS_URI, the configuration of Cyclone DDS, overrides
    `interface`. ConfigError if the network interface does not exist, or the configuration is
    invalid.
    """

    def __init__(self, config: Ros2Config) -> None:
        super().__init__()
        self._config = config
        try:
            self._domain = _domain(config)
            enclave = Policies(Policy.Userdata(b"enclave=/;"))
            with BINDING_LOCK:
                self._participant = DomainParticipant(config.domain_id, qos=enclave)
        except DDSException as error:
            raise ConfigError(
                f"no DDS on interface {config.interface!r}, domain {config.domain_id}: {error.msg}",
                "interface is the name of a network interface or its address, empty for the "
                "choice of Cyclone DDS; CYCLONEDDS_URI configures all else.",
            ) from error
        with BINDING_LOCK:
            self._graph = DdsGraph(self._participant, config)
        self._publishers: list[_DdsPublisher] = []
        self._threads: list[threading.Thread] = []
        self._stop = GuardCondition(self._participant)

    def publisher(self, topic: str, kind: str, qos: Qos = DEFAULT) -> Ros2Publisher:
        """Announce a topic, see the base class."""
        with BINDING_LOCK:
            entity = self._topic(topic, kind)
            writer = DataWriter(self._participant, entity, qos=self._policies(qos, kind))
        self._graph.add_writer(writer)
        publisher = _DdsPublisher(writer, cdr_type(kind), self.counters, self._graph)
        self._publishers.append(publisher)
        return publisher

    def subscribe(self, topic: str, kind: str, receive: Receive, qos: Qos = DEFAULT) -> None:
        """Receive a topic, see the base class.

        A publisher whose type has another name or structure is counted once: Cyclone DDS does not
        deliver its messages.
        """
        with BINDING_LOCK:
            entity = self._topic(topic, kind)
            reader = DataReader(self._participant, entity, qos=self._policies(qos, kind))
        self._graph.add_reader(reader)
        subscription = _Subscription(self.counters, reader, kind, qos.depth)

        def work() -> None:
            subscription.run(
                self._participant, self._stop, lambda sample: self.deliver(receive, sample)
            )

        thread = threading.Thread(target=work, name=f"dds {topic}", daemon=True)
        self._threads.append(thread)
        thread.start()

    def close(self) -> None:
        """End all publishers and subscriptions, and leave the network."""
        self._stop.set(True)
        for thread in self._threads:
            thread.join(CLOSE_S)
        for publisher in self._publishers:
            publisher.close()
        self._graph.close()

    def _topic(self, topic: str, kind: str) -> Any:
        name = resolve(topic, self._config.namespace)
        return Topic(self._participant, f"rt{name}", cdr_type(kind))

    def _policies(self, qos: Qos, kind: str) -> Policies:
        history = Policy.History.KeepLast(qos.depth)
        policies: list[Any] = [
            history,
            Policy.Reliability.Reliable(duration(seconds=BLOCK_S))
            if qos.reliability == "reliable"
            else Policy.Reliability.BestEffort,
            # The encoding of ROS 2.
            Policy.DataRepresentation(use_cdrv0_representation=True),
        ]
        if qos.durability == "transient_local":
            policies += [
                Policy.Durability.TransientLocal,
                Policy.DurabilityService(0, history, UNLIMITED, UNLIMITED, UNLIMITED),
            ]
        if self._config.distribution != "humble":
            policies.append(Policy.Userdata(f"typehash={type_hash(kind)};".encode()))
        return Policies(*policies)


class _DdsPublisher(Ros2Publisher):
    def __init__(
        self, writer: Any, sample: type[CdrSample], counters: Counter[str], graph: DdsGraph
    ) -> None:
        self._writer = writer
        self._sample = sample
        self._counters = counters
        self._graph = graph

    def send(self, cdr: bytes) -> None:
        """Publish a message; Cyclone DDS rejects payloads of another type."""
        try:
            if self._writer is not None:
                self._writer.write(self._sample(cdr))
        except DDSException:
            self._counters["send_errors"] += 1

    def close(self) -> None:
        """Leave the topic."""
        if self._writer is not None:
            self._graph.remove_writer(self._writer)
            self._writer = None  # deletes it


class _Subscription:
    """One reader, and the types of its publishers."""

    def __init__(self, counters: Counter[str], reader: Any, kind: str, depth: int) -> None:
        self._counters = counters
        self._reader = reader
        self._kind = kind
        self._depth = depth
        self._of_type: dict[int, bool] = {}  # True if the type matches, by handle of the publisher

    def run(self, participant: Any, stop: Any, receive: Receive) -> None:
        """Deliver messages until `stop` is set."""
        new = ReadCondition(self._reader, NEW)
        with BINDING_LOCK:
            publishers = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
        self._reader.status_mask = DDSStatus.RequestedIncompatibleQos
        waitset = WaitSet(participant)
        found = ReadCondition(publishers, NEW)
        for entity in (new, stop, found, self._reader):
            waitset.attach(entity)
        while not stop.read():
            waitset.wait(duration(infinite=True))
            self._check(publishers)
            for sample in self._reader.take(self._depth, condition=new):
                info = sample.sample_info
                if self._is_of_type(info.publication_handle):
                    receive(Ros2Sample(sample.cdr, info.source_timestamp))
                else:
                    self._counters["other_type"] += 1

    def _check(self, publishers: Any) -> None:
        """Count publishers rejected by Cyclone DDS for their type or quality of service."""
        refused = self._reader.get_requested_incompatible_qos_status()
        cause = "other_type" if refused.last_policy_id == TYPE_CONSISTENCY else "other_qos"
        self._counters[cause] += refused.total_count_change
        topic = self._reader.topic
        with BINDING_LOCK:
            arrived = publishers.take(MAX_PUBLISHERS)
        for found in arrived:
            if found.topic_name == topic.name and found.type_name != topic.typename:
                self._counters["other_type"] += 1

    def _is_of_type(self, handle: int) -> bool:
        if handle not in self._of_type:
            with BINDING_LOCK:
                publisher = self._reader.get_matched_publication_data(handle)
            # None: the publisher left before its last message was read.
            self._of_type[handle] = publisher is None or self._matches(publisher)
        return self._of_type[handle]

    def _matches(self, publisher: Any) -> bool:
        data = publisher.qos[Policy.Userdata]
        found = TYPE_HASH.search(data.data) if data else None
        same_hash = found is None or found[1].decode() == type_hash(self._kind)
        return same_hash and publisher.type_name == dds_name(self._kind)


def _domain(config: Ros2Config) -> Domain | None:
    """Return the configured domain, or None if the environment configures Cyclone DDS."""
    if os.environ.get("CYCLONEDDS_URI"):
        return None
    key = config.domain_id, config.interface
    domain = _domains.get(key)
    if domain is None:
        domain = _domains[key] = Domain(config.domain_id, _configuration(config.interface))
    return domain


def _configuration(interface: str) -> str:
    """Return the configuration of Cyclone DDS for one network interface."""
    if not interface:
        return "<CycloneDDS/>"
    try:
        local = ip_address(interface).is_loopback
        attribute = f"address={quoteattr(interface)}"
    except ValueError:
        local = interface == "lo"
        attribute = f"name={quoteattr(interface)}"
    multicast = "<AllowMulticast>false</AllowMulticast>" if local else ""
    return (
        '<CycloneDDS><Domain id="any"><General>'
        f"<Interfaces><NetworkInterface {attribute}/></Interfaces>{multicast}</General>"
        f"{LOCAL_DISCOVERY if local else ''}</Domain></CycloneDDS>"
    )
