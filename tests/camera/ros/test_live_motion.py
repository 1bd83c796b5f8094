"""Live odometry, wheels and transforms of ROS 2: valid and damaged bytes, end to end."""

import math
import random
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import zenoh

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transforms import LINK_FROM_OPTICAL
from common.geometry.wheel_odometry import WheelConfig
from common.runtime.loop import Loop
from common.transport.trace import ProcessId
from common.transport.zenoh_bus import read_config
from people4d.codec import MAX_BYTES
from people4d.errors import ConfigError, DecodeError
from people4d.messages import Health, Message, MovingTransform, Odometry, StaticTransform
from people4d.topics import ForeignTopic
from services.camera.config import CameraConfig, MotionConfig
from services.camera.node import CameraNode
from services.camera.ros.live_motion import LiveMotion, TransformMessage
from services.camera.source import SourceFrame
from tests.camera.memory import MemorySource, capture
from tests.camera.ros.bags import Ros
from tests.camera.ros.test_motion import NO_TURN, joints, quaternion, tf
from tests.network import WAIT_S, Network, Watcher

pytestmark = pytest.mark.network

ROS = Ros(2)
S = 10**9
ALL = MotionConfig(odometry="zenoh:odom", transforms=("zenoh:/tf", "zenoh:tf_static"))


def cdr(message: Any, kind: str) -> bytes:
    return bytes(ROS.store.serialize_cdr(message, kind))


def odometry(stamp_ns: int, x: float = 1.0, yaw_rad: float = 0.5) -> bytes:
    return cdr(ROS.odometry(x, -2.0, yaw_rad, stamp_ns), "nav_msgs/msg/Odometry")


def transforms(stamp_ns: int, *items: Any) -> bytes:
    return cdr(tf(ROS, stamp_ns, *items), "tf2_msgs/msg/TFMessage")


def topics(config: MotionConfig = ALL) -> dict[str, ForeignTopic]:
    return {topic.key: topic for topic in LiveMotion(config).topics}


def test_odometry() -> None:
    got = topics()["odom"].decode(odometry(5 * S + 7))
    assert isinstance(got, Odometry)
    assert (got.stamp_ns, got.frame_id, got.child_frame_id) == (5 * S + 7, "odom", "base_link")
    assert (got.x_m, got.y_m, got.theta_rad) == pytest.approx((1.0, -2.0, 0.5))
    assert got.covariance is not None
    assert got.covariance.tolist() == np.diag([0.1, 0.2, 0.3]).tolist()
    assert got.twist is not None
    assert got.twist.tolist() == [0.5, 0.0, 0.25]


def test_transforms_by_hand() -> None:
    # Encapsulation 0001 (little-endian), one transform, stamp 5 s + 7 ns, "a", "b", (1, 2, 3), no
    # turn. Strings have their length, a zero and padding to four; numbers are aligned to eight.
    words = "00010000 01000000 05000000 07000000 02000000 61000000 02000000 62000000 00000000"
    numbers = np.array([1, 2, 3, 0, 0, 0, 1], "<f8").tobytes()
    head = bytes.fromhex(words)
    got = topics()["tf"].decode(head[: 4 + 8 * math.ceil((len(head) - 4) / 8)] + numbers)
    assert isinstance(got, TransformMessage)
    (edge,) = got.transforms
    assert (edge.parent, edge.child, edge.stamp_ns) == ("a", "b", 5 * S + 7)
    assert edge.matrix[:3, 3].tolist() == [1, 2, 3]


KINDS: list[tuple[str, Callable[[], bytes], MotionConfig]] = [
    ("odom", lambda: odometry(5), ALL),
    (
        "tf",
        lambda: transforms(5, ("a", "b", (1, 2, 3), NO_TURN), ("b", "c", (1, 2, 3), NO_TURN)),
        ALL,
    ),
    (
        "joint_states",
        lambda: cdr(joints(ROS, 5, 1.0, 2.0), "sensor_msgs/msg/JointState"),
        MotionConfig(joints="zenoh:joint_states"),
    ),
]


@pytest.mark.parametrize(("key", "make", "config"), KINDS, ids=[kind[0] for kind in KINDS])
def test_bad_bytes_raise_nothing_but_decode_error(
    key: str, make: Callable[[], bytes], config: MotionConfig
) -> None:
    motion = LiveMotion(config)
    (topic,) = (topic for topic in motion.topics if topic.key == key)
    good, rng = make(), random.Random(7)
    bad = [good[:n] for n in range(len(good) - 4)]
    bad += [rng.randbytes(rng.randrange(300)) for _ in range(300)]
    for _ in range(1500):
        damaged = bytearray(good)
        damaged[rng.randrange(len(good))] = rng.randrange(256)
        bad.append(bytes(damaged))
    bad.append(good + bytes(MAX_BYTES))
    problems = []
    for payload in bad:
        try:
            message = topic.decode(payload)  # some damage is another number
        except DecodeError as error:
            problems.append(str(error))
        else:
            assert type(message) is topic.message
            motion.convert(message, ["b", "c"])
    assert len(problems) > 300
    assert max(map(len, problems)) < 300
    assert f"at most {MAX_BYTES} bytes" in problems[-1]


def test_what_has_no_time_is_refused() -> None:
    with pytest.raises(DecodeError, match=r"header\.stamp, got 0"):
        topics()["odom"].decode(odometry(0))
    motion = LiveMotion(ALL)
    (tf_topic,) = (topic for topic in motion.topics if topic.key == "tf")
    timeless = tf_topic.decode(transforms(0, ("a", "b", (0, 0, 0), NO_TURN)))
    assert motion.convert(timeless, ["b"]) == []
    assert motion.counters["bad_transforms"] == 1


def test_settings_that_cannot_be() -> None:
    for text in ("zenoh:", "a//b", "zenoh:a/*", "zenoh:a b"):
        with pytest.raises(ConfigError, match=r"is not a key\. Write zenoh: and the ROS topic"):
            LiveMotion(MotionConfig(odometry=text))
    with pytest.raises(ValueError, match="odometry, joints: expected one of them, got both"):
        MotionConfig(odometry="zenoh:odom", joints="zenoh:joint_states")
    with pytest.raises(ValueError, match="offset_s"):
        MotionConfig(offset_s=math.inf)


def test_only_what_the_camera_hangs_on_is_passed_on() -> None:
    # camera <- tilt <- pan <- base_link <- odom <- map; the arm is not used, and odometry gives
    # odom <- base_link.
    motion = LiveMotion(ALL)
    by_key = {topic.key: topic for topic in motion.topics}
    assert motion.silent == ["odom", "tf", "tf_static"]

    def taken(key: str, payload: bytes) -> list[Message]:
        return motion.convert(by_key[key].decode(payload), ["camera", "tilt"])

    (base,) = taken("odom", odometry(S))
    assert isinstance(base, Odometry)
    items = [
        ("pan", "tilt", (0, 0, 0.1), quaternion(0, 0.2, 0)),
        ("/base_link", "/pan", (0, 0, 1), quaternion(0, 0, 0.3)),
        ("base_link", "arm", (0, 1, 0), NO_TURN),
        ("odom", "base_link", (1, -2, 0), NO_TURN),
        ("map", "odom", (5, 0, 0), NO_TURN),
    ]
    messages = taken("tf", transforms(S, *items))
    assert all(isinstance(message, MovingTransform) for message in messages)
    names = [(m.parent, m.child, m.sequence) for m in messages if isinstance(m, MovingTransform)]
    assert names == [("pan", "tilt", 0), ("base_link", "pan", 1), ("map", "odom", 2)]
    (fixed,) = taken("tf_static", transforms(0, ("tilt", "camera", (0, 0, 0), NO_TURN)))
    assert isinstance(fixed, StaticTransform)
    assert motion.silent == []
    assert motion.counters["other_transforms"] == 2
    # Both transforms together give the pose of the camera.
    known = TransformBuffer()
    for message in (base, *messages, fixed):
        assert isinstance(message, Odometry | MovingTransform | StaticTransform)
        known.add_transform(message)
    pose = known.lookup("map", "camera", S)
    assert pose is not None
    # 5 + 1 ahead; 2 to the right, since pan and tilt only turn; 1 + 0.1 up.
    assert pose.matrix[:3, 3] == pytest.approx([6, -2, 1.1])


def test_clock_offset_and_numbers() -> None:
    motion = LiveMotion(MotionConfig(odometry="zenoh:odom", offset_s=-0.1))
    (topic,) = motion.topics
    messages = [motion.convert(topic.decode(odometry(S + k)), [])[0] for k in range(3)]
    assert [(m.stamp_ns - S, m.sequence) for m in messages] == [(k - S // 10, k) for k in range(3)]


def test_wheels_that_are_joints_make_odometry() -> None:
    # The right wheel of 0.05 m turns by 2 rad: 0.1 m over 0.2 m is 0.5 rad to the left.
    wheels = WheelConfig(radius_m=0.05, track_m=0.2)
    motion = LiveMotion(MotionConfig(joints="zenoh:joint_states", wheels=wheels))
    (topic,) = motion.topics
    kind = "sensor_msgs/msg/JointState"
    for stamp_ns, right in ((S, 0.0), (2 * S, 2.0)):
        (got,) = motion.convert(topic.decode(cdr(joints(ROS, stamp_ns, 0.0, right), kind)), [])
    assert isinstance(got, Odometry)
    assert got.stamp_ns == 2 * S
    assert got.theta_rad == pytest.approx(0.5)


class OneFrame(MemorySource):
    """A camera that has sent frames, and then nothing until it is closed."""

    def __init__(self) -> None:
        super().__init__([capture(1)], live=True)
        self.ended = threading.Event()

    def __iter__(self) -> Iterator[SourceFrame | Odometry]:
        yield from self.items  # type: ignore[misc]
        self.ended.wait(WAIT_S)


def test_from_cdr_on_the_keys_of_the_ros_bridge_to_our_topics(
    network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("common.runtime.heartbeat.PERIOD_S", 0.05)
    robot = network.robot()
    watcher = Watcher(network.open(robot), Odometry, MovingTransform, StaticTransform, Health)
    config = CameraConfig(motion=ALL, mount_parent="tilt", start_delay_s=0.0)
    source = OneFrame()
    node = CameraNode(config, source)
    loop = Loop(node, network.open(robot), ProcessId("camera", "camera-1", "robot"))
    thread = threading.Thread(target=loop.run)
    thread.start()
    try:
        mount = watcher.wait(StaticTransform)
        assert (mount.parent, mount.matrix.tolist()) == ("tilt", LINK_FROM_OPTICAL.tolist())
        waiting = watcher.wait(Health, lambda health: health.reason)
        assert waiting.reason == "no messages on odom, tf, tf_static"
        with zenoh.open(read_config(None, "client", network.environment)) as session:
            odom, moved = (session.declare_publisher(key) for key in ("odom", "tf"))
            for k in range(1, 20):
                odom.put(b"\x00\x01\x00\x00junk")
                odom.put(odometry(k * S))
                items = ("base_link", "tilt", (0, 0, 1), NO_TURN), ("a", "b", (0, 0, 1), NO_TURN)
                moved.put(transforms(k * S, *items))
            assert watcher.wait(Odometry, lambda m: m.stamp_ns == 19 * S).sequence == 18
            last = watcher.wait(MovingTransform, lambda m: m.stamp_ns == 19 * S)
            assert (last.parent, last.child, last.sequence) == ("base_link", "tilt", 18)
            watcher.wait_for_counters(bad_live_odometry=19, other_transforms=19)
    finally:
        source.ended.set()
        loop.stop()
        thread.join()
