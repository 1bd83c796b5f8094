"""Truth read from recordings, ROS bags and gt.npz."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags import rosbag1, rosbag2
from rosbags.typesys.store import Typestore

from common.io.recording import RecordingWriter
from common.io.ros_bag import PEOPLE, make_typestore
from people4d.errors import ConfigError, SourceError
from people4d.messages import Truth, TruthPerson
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.sources.registry import open_truth
from tests import ROOT, builders


def read(path: Path, **settings: Any) -> list[Truth]:
    return list(open_truth(GtBridgeConfig(truth=str(path), **settings)))


def people(store: Typestore, x: float, sec: int, ros1: bool) -> Any:
    types = store.types
    point, stamp = types["geometry_msgs/msg/Point"], types["builtin_interfaces/msg/Time"]
    header: dict[str, Any] = {"stamp": stamp(sec=sec, nanosec=500), "frame_id": "/map"}
    header |= {"seq": 0} if ros1 else {}
    person = types["people_msgs/msg/Person"](
        name="anna",
        position=point(x=x, y=2.0, z=1.0),
        velocity=point(x=0.5, y=0.0, z=0.0),
        reliability=1.0,
        tagnames=[],
        tags=[],
    )
    return types[PEOPLE](header=types["std_msgs/msg/Header"](**header), people=[person])


def write_ros1(folder: Path, *topics: str) -> Path:
    store, path = make_typestore(1, {}), folder / "people.bag"
    with rosbag1.Writer(path) as writer:
        for topic in topics:
            connection = writer.add_connection(topic, PEOPLE, typestore=store)
            for k in range(3):
                data = store.serialize_ros1(people(store, float(k), 10 + k, True), PEOPLE)
                writer.write(connection, (10 + k) * 10**9, data)
    return path


def write_ros2(
    folder: Path, *topics: str, plugin: rosbag2.StoragePlugin = rosbag2.StoragePlugin.SQLITE3
) -> Path:
    store, path = make_typestore(2, {}), folder / "people"
    with rosbag2.Writer(path, version=9, storage_plugin=plugin) as writer:
        for topic in topics:
            connection = writer.add_connection(topic, PEOPLE, typestore=store)
            for k in range(3):
                data = store.serialize_cdr(people(store, float(k), 10 + k, False), PEOPLE)
                writer.write(connection, (10 + k) * 10**9, data)
    return path


def write_mcap(folder: Path, *topics: str) -> Path:
    bag = write_ros2(folder, *topics, plugin=rosbag2.StoragePlugin.MCAP)
    return next(bag.glob("*.mcap"))


@pytest.mark.parametrize("write", [write_ros1, write_ros2, write_mcap])
def test_people_of_a_ros_bag(write: Callable[..., Path], tmp_path: Path) -> None:
    messages = read(write(tmp_path, "/people"))
    assert [m.stamp_ns for m in messages] == [10_000_000_500, 11_000_000_500, 12_000_000_500]
    assert [m.frame_id for m in messages] == ["map"] * 3
    (person,) = messages[2].people
    assert person.id == "anna"
    assert person.position_m.tolist() == [2.0, 2.0, 1.0]
    assert person.velocity_mps is not None
    assert person.velocity_mps.tolist() == [0.5, 0.0, 0.0]
    assert person.yaw_rad is None


def test_a_bag_with_two_topics_wants_one_named(tmp_path: Path) -> None:
    path = write_ros2(tmp_path, "/mocap", "/tracker")
    with pytest.raises(SourceError, match="Set topic to one of /mocap, /tracker"):
        read(path)
    assert len(read(path, topic="/mocap")) == 3
    with pytest.raises(SourceError, match=r"no topic /other.*It has /mocap, /tracker"):
        read(path, topic="/other")


def test_bag_without_people_is_refused_with_its_topics(tmp_path: Path) -> None:
    store = make_typestore(2, {})
    with rosbag2.Writer(tmp_path / "bag", version=9) as writer:
        connection = writer.add_connection("/text", "std_msgs/msg/String", typestore=store)
        text = store.types["std_msgs/msg/String"](data="hello")
        writer.write(connection, 1, store.serialize_cdr(text, "std_msgs/msg/String"))
    with pytest.raises(SourceError, match=r"no people_msgs/People.*/text \(std_msgs/String\)"):
        read(tmp_path / "bag")


def test_recording_without_truth_is_refused_with_its_topics(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "x.mcap") as writer:
        writer.write(builders.odometry(stamp_ns=1), 1)
    with pytest.raises(SourceError, match=r"holds no truth. It holds odometry"):
        read(tmp_path / "x.mcap")


def test_truth_of_a_recording(tmp_path: Path) -> None:
    person = TruthPerson(id="0", position_m=np.array([1.0, 2.0, 3.0]), yaw_rad=0.5)
    sent = builders.truth(person, stamp_ns=5)
    with RecordingWriter(tmp_path / "x.mcap") as writer:
        writer.write(sent, 5)
    (got,) = read(tmp_path / "x.mcap")
    assert (got.stamp_ns, got.people[0].yaw_rad) == (5, 0.5)
    assert got.people[0].position_m.tolist() == [1.0, 2.0, 3.0]


def write_lab(path: Path, **changes: Any) -> Path:
    arrays = {
        "t": np.array([0.0, 0.1]),
        "pos": np.arange(12.0).reshape(2, 2, 3),
        "vel": np.zeros((2, 2, 3)),
        "yaw": np.array([[0.0, 1.0], [2.0, 3.0]]),
    } | changes
    np.savez(path, **arrays)
    return path


def test_truth_of_the_lab(tmp_path: Path) -> None:
    first, second = read(write_lab(tmp_path / "gt.npz"))
    assert (first.stamp_ns, second.stamp_ns) == (0, 100_000_000)
    assert [p.id for p in second.people] == ["0", "1"]
    assert second.people[1].position_m.tolist() == [9.0, 10.0, 11.0]
    assert second.people[1].yaw_rad == 3.0
    assert read(tmp_path)[0].stamp_ns == first.stamp_ns  # by its folder


@pytest.mark.parametrize("name", ["x.npz", "x.bag", "x.mcap", "x.db3"])
@pytest.mark.parametrize("content", [b"", b"junk" * 100])
def test_junk_is_reported_in_one_sentence(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SourceError):
        read(tmp_path / name)


def test_absent_file_and_unknown_source(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="does not exist"):
        read(tmp_path / "none.bag")
    with pytest.raises(SourceError, match="unsupported format"):
        read(tmp_path)  # a folder with neither bag nor gt.npz
    with pytest.raises(ConfigError, match="source 'vicon' is unknown"):
        read(tmp_path, source="vicon")
    with pytest.raises(ConfigError, match="cannot be loaded"):
        read(tmp_path, source="no.such:Reader")
    assert list(open_truth(GtBridgeConfig())) == []


def test_the_lab_files_read(shared: Path) -> None:
    messages = read(shared / "data/lab/two/gt.npz")
    assert len(messages) == 150
    assert all(len(m.people) == 2 for m in messages)


def test_the_demo_recording_holds_truth() -> None:
    demo = ROOT / "deploy/demo/crossing.mcap"
    assert len(read(demo)) == 901
