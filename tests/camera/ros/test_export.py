"""Recordings written as ROS 2 bags and read again."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader

from common.io.recording import RecordingWriter
from people4d.errors import SourceError
from people4d.messages import Message, Odometry, RgbdFrame, Tracks, Truth, TruthPerson
from services.camera.recording import RecordingOptions, RecordingSource
from services.camera.ros.camera import RosbagOptions
from services.camera.ros.export import BagFormat, export
from services.camera.ros.source import RosbagSource
from services.camera.source import SourceFrame
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.sources.ros import RosbagTruth
from tests import builders

S = 10**9
START_NS = 1_700_000_000 * S
SIZE = (12, 16)
# z of the lens along the base's x, 0.2 m ahead of it and 0.5 m above.
BASE_FROM_OPTICAL = np.array([[0, 0, 1, 0.2], [-1, 0, 0, 0], [0, -1, 0, 0.5], [0, 0, 0, 1.0]])
TOPICS = {
    "/camera/color/image_raw": 3,
    "/camera/color/camera_info": 3,
    "/camera/aligned_depth_to_color/image_raw": 3,
    "/camera/aligned_depth_to_color/camera_info": 3,
    "/odom": 2,
    "/tf": 2,
    "/tf_static": 1,
    "/truth": 2,
    "/people": 1,
}


def frame(k: int) -> RgbdFrame:
    ramp = np.arange(SIZE[0] * SIZE[1], dtype=np.uint16).reshape(SIZE)
    rgb = np.full((*SIZE, 3), (40 * k, 100, 200), np.uint8)
    depth_mm = 1000 + 300 * k + ramp
    depth_mm[0, 0] = 0
    return RgbdFrame(
        stamp_ns=START_NS + k * S // 10, sequence=k, camera="front", rgb=rgb, depth_mm=depth_mm
    )


def odometry(k: int) -> Odometry:
    return builders.odometry(
        stamp_ns=START_NS + k * S // 10 + 5,
        sequence=k,
        x_m=0.25 * k,
        y_m=-0.5,
        theta_rad=-2.5,
        covariance=np.array([[0.1, 0.01, 0.0], [0.01, 0.2, 0.0], [0.0, 0.0, 0.3]]),
        twist=np.array([0.4, 0.0, -0.7]),
    )


def truth(k: int) -> Truth:
    walker = TruthPerson(
        id="anna",
        position_m=np.array([3.0, 0.1 * k, 1.2]),
        velocity_mps=np.array([0.0, 1.0, 0.0]),
        yaw_rad=1.0 / 3.0,
        path_yaw_rad=-0.1,
    )
    return builders.truth(walker, stamp_ns=START_NS + k * S // 100, sequence=k)


def tracks() -> Tracks:
    person = builders.track(
        id=7,
        state="lost",
        position_m=np.array([3.0, 0.0, 1.0]),
        age=4,
        time_since_update_s=0.1,
        detection=None,
        score=0.75,
    )
    return builders.tracks(person, stamp_ns=START_NS + 7, camera="c")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "walk.mcap"
    info = builders.camera_info(
        stamp_ns=START_NS, width=SIZE[1], height=SIZE[0], fx=20.0, fy=21.0, cx=7.5, cy=5.5
    )
    mount = builders.static_transform(BASE_FROM_OPTICAL, stamp_ns=START_NS, parent="base_link")
    messages: list[Message] = [info, mount, *map(frame, range(3)), tracks()]
    messages += [*map(odometry, range(2)), *map(truth, range(2))]
    with RecordingWriter(path) as writer:
        for message in sorted(messages, key=lambda message: message.stamp_ns):
            writer.write(message, message.stamp_ns)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_any_reader_finds_the_topics_of_a_driver(
    recording: Path, tmp_path: Path, storage: str
) -> None:
    assert export(recording, tmp_path / "bag", BagFormat(storage=storage)) == TOPICS
    with AnyReader([tmp_path / "bag"]) as reader:
        assert {c.topic: c.msgcount for c in reader.connections} == TOPICS
        times_ns = [time_ns for _, time_ns, _ in reader.messages()]
        people = [c for c in reader.connections if c.topic == "/people"]
        _, _, data = next(reader.messages(people))
        message: Any = reader.deserialize(data, people[0].msgtype)
    person = message.people[0]
    assert times_ns == sorted(times_ns)
    assert times_ns[0] == START_NS
    assert (person.name, person.reliability) == ("7", 0.75)
    expected = {"id": "7", "group": "-1", "state": "lost"}
    assert dict(zip(person.tagnames, person.tags, strict=True)) == expected


def test_static_transforms_reach_late_subscribers(recording: Path, tmp_path: Path) -> None:
    export(recording, tmp_path / "bag")
    text = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
    topics = text["rosbag2_bagfile_information"]["topics_with_message_count"]
    profiles = {
        t["topic_metadata"]["name"]: yaml.safe_load(t["topic_metadata"]["offered_qos_profiles"])
        for t in topics
    }
    # rmw: durability 1 is transient local, 2 volatile; reliability 1 is reliable
    assert [profiles["/tf_static"][0][key] for key in ("durability", "reliability")] == [1, 1]
    assert profiles["/tf"][0]["durability"] == 2


@pytest.mark.slow
@pytest.mark.parametrize("compressed", [False, True])
def test_a_bag_plays_as_the_recording_does(
    recording: Path, tmp_path: Path, compressed: bool
) -> None:
    export(recording, tmp_path / "bag", BagFormat(compressed=compressed, namespace="front"))
    ours = RecordingSource(recording, RecordingOptions())
    theirs = RosbagSource(tmp_path / "bag", RosbagOptions())
    known = ("frame_id", "width", "height", "fx", "fy", "cx", "cy", "distortion")
    assert all(getattr(ours.info, name) == getattr(theirs.info, name) for name in known)
    assert theirs.transforms[0].parent == "base_link"
    assert np.allclose(theirs.transforms[0].matrix, BASE_FROM_OPTICAL, atol=1e-12)
    assert theirs.registration is None
    captures = [item for item in ours if isinstance(item, SourceFrame)]
    found = [item for item in theirs if isinstance(item, SourceFrame)]
    assert [c.stamp_ns for c in found] == [c.stamp_ns for c in captures]
    for a, b in zip(captures, found, strict=True):
        assert np.array_equal(a.depth_mm, b.depth_mm)
        # JPEG of a uniform colour: another encoding changes a level by one or two
        assert np.abs(a.rgb.astype(int) - b.rgb).max() <= (2 if compressed else 0)
    moves = [item for item in theirs if isinstance(item, Odometry)]
    for k, move in enumerate(moves):
        want = odometry(k)
        assert (move.stamp_ns, move.frame_id) == (want.stamp_ns, want.frame_id)
        assert (move.x_m, move.y_m) == (want.x_m, want.y_m)
        assert move.theta_rad == pytest.approx(want.theta_rad, abs=1e-12)
        assert np.array_equal(move.covariance, want.covariance)  # type: ignore[arg-type]
        assert np.array_equal(move.twist, want.twist)  # type: ignore[arg-type]


def test_truth_comes_back_with_its_yaw(recording: Path, tmp_path: Path) -> None:
    export(recording, tmp_path / "bag")
    config = GtBridgeConfig(truth=str(tmp_path / "bag"), topic="/truth")
    for got, want in zip(RosbagTruth(config), map(truth, range(2)), strict=True):
        assert (got.stamp_ns, got.frame_id) == (want.stamp_ns, want.frame_id)
        assert got.people[0].id == "anna"
        assert got.people[0].yaw_rad == want.people[0].yaw_rad
        assert got.people[0].path_yaw_rad == want.people[0].path_yaw_rad
        assert np.array_equal(got.people[0].position_m, want.people[0].position_m)
        assert np.array_equal(got.people[0].velocity_mps, want.people[0].velocity_mps)  # type: ignore[arg-type]


def test_existing_bag_is_not_overwritten(recording: Path, tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    with pytest.raises(SourceError, match="exists already"):
        export(recording, tmp_path / "bag")
    assert list((tmp_path / "bag").iterdir()) == []


def test_a_bag_that_breaks_off_leaves_nothing(recording: Path, tmp_path: Path) -> None:
    def stop(share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(recording, tmp_path / "bag", on_progress=stop)
    assert not (tmp_path / "bag").exists()
