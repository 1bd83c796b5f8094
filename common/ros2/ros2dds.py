"""Topics of nodes behind a zenoh-bridge-ros2dds, which forwards them between DDS and Zenoh.

Source: sources of zenoh-plugin-ros2dds (liveliness_mgt.rs there).
"""

from collections.abc import Callable

from common.ros2 import types
from common.ros2.config import Ros2Config
from common.ros2.names import resolve
from common.ros2.transport import (
    DEFAULT,
    Qos,
    Receive,
    Ros2Publisher,
    Ros2Sample,
    Ros2Transport,
)
from common.ros2.zenoh_link import ZenohLink, ZenohPublisher


class Ros2Dds(Ros2Transport):
    """Bridge of one more host, as the other bridges take it, see `Ros2Transport`.

    Keys have no type: a message of another one is counted as bad_message. Nodes are not announced,
    since bridges make one of their own for each topic.
    """

    def __init__(self, config: Ros2Config) -> None:
        super().__init__()
        self._namespace = config.namespace
        self._link = ZenohLink(config)
        self._announced = f"@/{self._link.identity}/@ros2_lv"
        self._link.declare_token(self._announced)

    def publisher(self, topic: str, kind: str, qos: Qos = DEFAULT) -> Ros2Publisher:
        """Announce a topic, see `Ros2Transport.publisher`."""
        key, withdraw = self._announce("MP", topic, kind, qos)
        return ZenohPublisher(self._link.publisher(key, qos), withdraw, self.counters)

    def subscribe(self, topic: str, kind: str, receive: Receive, qos: Qos = DEFAULT) -> None:
        """Receive a topic, see `Ros2Transport.subscribe`."""
        key, _ = self._announce("MS", topic, kind, qos)
        self._link.receive(
            key, qos, lambda cdr, *_: self.deliver(receive, Ros2Sample(cdr, sent_ns=0))
        )

    def close(self) -> None:
        """Leave the network, see `Ros2Transport.close`."""
        self._link.close()

    def _announce(
        self, role: str, topic: str, kind: str, qos: Qos
    ) -> tuple[str, Callable[[], None]]:
        """Declare a publisher or subscription; return its key, and what withdraws it."""
        types.type_hash(kind)  # refuses unknown types
        key = resolve(topic, self._namespace).removeprefix("/")
        escaped = f"{key.replace('/', '§')}/{kind.replace('/', '§')}"
        token = f"{self._announced}/{role}/{escaped}/{_qos_text(qos)}"
        return key, self._link.declare_token(token)


def _qos_text(qos: Qos) -> str:
    """Return a quality of service as in tokens: keyed, reliability, durability, history."""
    reliable, latched = qos.reliability == "reliable", qos.durability == "transient_local"
    return f":{int(reliable)}:{int(latched)}:0,{qos.depth}"
