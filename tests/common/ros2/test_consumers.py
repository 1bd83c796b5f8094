"""Third-party consumers of published messages: a recorder, and the example planners."""

import ast
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("zenoh_ros2_sdk")

from mcap.writer import Writer
from rosbags.highlevel import AnyReader

from common.ros2.config import Ros2Config
from common.ros2.rmw_zenoh import RmwZenoh
from common.ros2.types import encode
from tests import ROOT
from tests.common.ros2.foreign import definition, inside, raw_session, until
from tests.common.ros2.messages import filled, plain
from tests.network import Network

pytestmark = pytest.mark.network

EXAMPLES = ROOT / "examples" / "ros2"
RECORDED = (
    *("people_msgs/msg/People", "social_nav_msgs/msg/PedestriansWithCovariance"),
    *("cohan_msgs/msg/TrackedAgents", "spencer_tracking_msgs/msg/TrackedPersons"),
    *("hri_msgs/msg/Skeleton2D", "vision_msgs/msg/Detection3DArray"),
    *("visualization_msgs/msg/MarkerArray", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"),
    "diagnostic_msgs/msg/DiagnosticArray",
)
PERSON = {"position": {"x": 1.0}, "velocity": {"x": -0.5}, "tagnames": ["id"], "tags": ["7", "-1"]}


def schema(kind: str) -> bytes:
    """Return a type with its nested types, as ROS 2 writes it into MCAP."""
    *others, _ = inside(kind)
    parts = [definition(kind)]
    parts += [f"MSG: {name.replace('/msg/', '/')}\n{definition(name)}" for name in others]
    return f"\n{'=' * 80}\n".join(parts).encode()


def test_rosbags_reads_what_a_recorder_on_zenoh_wrote(network: Network, tmp_path: Path) -> None:
    node = RmwZenoh(Ros2Config(endpoints=(network.endpoint,), node="recorded"))
    sent = {f"/{kind.replace('/', '_')}": (kind, filled(kind)) for kind in RECORDED}
    publishers = {topic: node.publisher(topic, kind) for topic, (kind, _) in sent.items()}
    path = tmp_path / "recorded.mcap"
    with raw_session(network.endpoint) as session, path.open("wb") as file:
        writer: Any = Writer(file)
        writer.start("ros2", "a recorder")
        channels: dict[str, int] = {}
        lock = threading.Lock()

        def record(sample: Any) -> None:
            topic, name, _ = str(sample.key_expr).removeprefix("0").rsplit("/", 2)
            package, middle, _, last = name.split("::")
            kind = f"{package}/{middle}/{last.rstrip('_')}"
            with lock:
                if topic not in channels:
                    number = writer.register_schema(kind, "ros2msg", schema(kind))
                    channels[topic] = writer.register_channel(topic, "cdr", number)
                writer.add_message(channels[topic], 1, sample.payload.to_bytes(), 1)

        subscriber: Any = session.declare_subscriber("0/**", record)

        def send() -> None:
            for topic, (kind, fields) in sent.items():
                publishers[topic].send(encode(kind, fields))

        until(lambda: len(channels) == len(sent), send)
        subscriber.undeclare()
        writer.finish()
    node.close()
    with AnyReader([path]) as reader:
        read = {
            connection.topic: (
                connection.msgtype,
                plain(reader.deserialize(data, connection.msgtype)),
            )
            for connection, _, data in reader.messages()
        }
    assert read == sent


@pytest.mark.processes
def test_planner_in_python_advises(network: Network) -> None:
    node = RmwZenoh(Ros2Config(endpoints=(network.endpoint,), node="planned"))
    publisher = node.publisher("/people", "people_msgs/msg/People")
    cdr = encode("people_msgs/msg/People", {"people": [PERSON]})
    command = [sys.executable, str(EXAMPLES / "planner.py"), network.endpoint, "1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as planner:
        until(lambda: planner.poll() is not None, lambda: publisher.send(cdr))
        assert planner.stdout
        assert planner.stdout.read() == "#7 will be 0.50 m away: slow down\n"
    node.close()


def test_examples_that_do_not_run_here_say_so() -> None:
    names = {path.name for path in EXAMPLES.iterdir()}
    assert names == {
        *("planner.py", "planner.cpp", "planner_zenoh.cpp", "planner.rs", "planner.ts"),
        "people4d.launch.py",
    }
    for name in names - {"planner.py"}:
        assert "ntested" in (EXAMPLES / name).read_text("utf-8"), name
    ast.parse((EXAMPLES / "people4d.launch.py").read_text("utf-8"))
