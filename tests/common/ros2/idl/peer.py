"""Participant of DDS with its own types, in a process of its own; it has no code of ours.

    python -m tests.common.ros2.idl.peer DOMAIN NAMESPACE

It takes what is published on NAMESPACE/out/<package>_<type>, prints all fields as a line of JSON,
and publishes the object it made of them on NAMESPACE/back/<package>_<type>, until its input ends.
"""

import dataclasses
import json
import os
import sys
import threading
import time
from typing import Any

from cyclonedds.core import InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from tests.common.ros2.idl import types

QOS = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.History.KeepLast(10),
    Policy.Durability.TransientLocal,
)
LOOPBACK = """
<CycloneDDS><Domain id="any"><General><AllowMulticast>false</AllowMulticast>
<Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers>
</Discovery></Domain></CycloneDDS>
"""


def structures() -> dict[str, Any]:
    """Return the types by the name that ROS gives them, for example people_msgs/msg/People."""
    found: dict[str, Any] = {}
    for structure in IdlStruct.__subclasses__():
        if structure.__module__ == types.__name__:
            package, middle, _, last = structure.__idl_typename__.split(".")
            found[f"{package}/{middle}/{last.rstrip('_')}"] = structure
    return found


def main() -> None:
    """Echo until the input ends."""
    domain, namespace = int(sys.argv[1]), sys.argv[2]
    os.environ["CYCLONEDDS_URI"] = LOOPBACK
    participant = DomainParticipant(domain)
    ends = []
    for kind, structure in structures().items():
        name = kind.replace("/msg/", "_")
        reader = DataReader(
            participant, Topic(participant, f"rt{namespace}/out/{name}", structure), QOS
        )
        writer = DataWriter(
            participant, Topic(participant, f"rt{namespace}/back/{name}", structure), QOS
        )
        new = ReadCondition(reader, ViewState.Any | InstanceState.Alive | SampleState.NotRead)
        ends.append((kind, reader, writer, new))
    ended = threading.Event()

    def wait() -> None:
        sys.stdin.read()
        ended.set()

    threading.Thread(target=wait, daemon=True).start()
    print("ready", flush=True)
    while not ended.is_set():
        for kind, reader, writer, new in ends:
            for message in reader.take(10, condition=new):
                print(json.dumps([kind, dataclasses.asdict(message)]), flush=True)
                writer.write(message)
        time.sleep(0.01)


if __name__ == "__main__":
    main()
