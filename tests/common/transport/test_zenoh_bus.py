"""The bus between processes, on real sessions on the loopback interface."""

import json
import re
import threading
import time
from pathlib import Path

import msgspec
import numpy as np
import pytest
import zenoh

from common.transport.ports import free_port
from common.transport.zenoh_bus import ZenohBus, read_config
from people4d.codec import decode
from people4d.errors import ConfigError, People4dError
from people4d.messages import CameraInfo, Message, RgbdFrame, StaticTransform, Truth
from people4d.topics import BY_NAME, LOCKSTEP_MAX
from tests.contract.examples import BY_NAME as EXAMPLES
from tests.network import WAIT_S, Network, Watcher

pytestmark = pytest.mark.network


def numbered(name: str, sequence: int) -> Message:
    return msgspec.structs.replace(EXAMPLES[name], sequence=sequence)


def publish_until(arrived: threading.Event, bus: ZenohBus, message: Message) -> float:
    """Publish a message repeatedly until it arrives; return the time that this took [s]."""
    start = time.monotonic()
    while not arrived.wait(0.05):
        assert time.monotonic() - start < WAIT_S, "it never arrived"
        bus.publish(message)
    return time.monotonic() - start


def arrival(bus: ZenohBus, topic: str) -> threading.Event:
    """Return an event that is set when the first message of a topic arrives."""
    arrived = threading.Event()
    subscription = bus.subscribe(BY_NAME[topic])

    def receive() -> None:
        for _ in subscription:
            arrived.set()

    threading.Thread(target=receive, daemon=True).start()
    return arrived


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_a_late_subscriber_gets_the_last_of_each_key(network: Network, mode: str) -> None:
    robot = network.robot()
    camera = network.open(robot, mode)
    left, right = EXAMPLES["CameraInfo"], EXAMPLES["CameraInfo"]
    left = msgspec.structs.replace(left, camera="left", sequence=0)
    right = msgspec.structs.replace(right, camera="right", sequence=5)
    for message in (left, msgspec.structs.replace(left, sequence=1), right):
        camera.publish(message)
    camera.publish(EXAMPLES["StaticTransform"])
    watcher = Watcher(network.open(robot, mode))
    watcher.wait(CameraInfo, lambda m: (m.camera, m.sequence) == ("left", 1))
    watcher = Watcher(network.open(robot, mode))
    watcher.wait(CameraInfo, lambda m: (m.camera, m.sequence) == ("right", 5))
    watcher = Watcher(network.open(robot, mode))
    watcher.wait(StaticTransform)
    camera.publish(msgspec.structs.replace(left, sequence=2))
    watcher.wait(CameraInfo, lambda m: m.sequence == 2)


def test_late_publisher_is_received_at_once(network: Network) -> None:
    # Its session is not linked yet when it publishes; the message must still arrive.
    robot = network.robot()
    watcher = Watcher(network.open(robot, "peer"), CameraInfo)
    network.open(robot, "peer").publish(EXAMPLES["CameraInfo"])
    assert watcher.wait(CameraInfo).sequence == EXAMPLES["CameraInfo"].sequence


def test_busy_subscriber_gets_the_newest_frames(network: Network) -> None:
    robot = network.robot()
    camera, detector = network.open(robot), network.open(robot)
    frames, marks = detector.subscribe(BY_NAME["frames"]), Watcher(detector, Truth)
    publish_until(arrival(detector, "odometry"), camera, EXAMPLES["Odometry"])
    for sequence in range(20):
        camera.publish(numbered("RgbdFrame", sequence))
    # This message is the last one on the same link, so the frames have arrived.
    camera.publish(EXAMPLES["Truth"])
    marks.wait(Truth)
    waiting = iter(frames)
    got = [decode(next(waiting)[1]).sequence for _ in range(LOCKSTEP_MAX)]
    assert got == list(range(20 - LOCKSTEP_MAX, 20))


def test_frame_of_full_size_arrives_unchanged(network: Network) -> None:
    robot = network.robot()
    random = np.random.default_rng(0)
    frame = RgbdFrame(
        stamp_ns=1,
        sequence=1,
        camera="front",
        rgb=random.integers(0, 256, (480, 640, 3), np.uint8),
        depth_mm=random.integers(0, 65536, (480, 640), np.uint16),
    )
    camera, detector = network.open(robot), network.open(robot)
    watcher = Watcher(detector, RgbdFrame)
    publish_until(arrival(detector, "odometry"), camera, EXAMPLES["Odometry"])
    camera.publish(frame)
    again = watcher.wait(RgbdFrame)
    np.testing.assert_array_equal(again.rgb, frame.rgb)
    np.testing.assert_array_equal(again.depth_mm, frame.depth_mm)


def test_robots_do_not_receive_each_other(network: Network) -> None:
    one, other = network.robot(), network.robot()
    subscriber, publisher = network.open(one), network.open(other)
    watcher = Watcher(subscriber, Truth)
    publisher.publish(numbered("Truth", 1))
    subscriber.publish(numbered("Truth", 2))
    assert watcher.wait(Truth).sequence == 2


@pytest.mark.parametrize("topic", ["people", "camera_info"])
def test_closing_ends_a_reader_that_waits(network: Network, topic: str) -> None:
    bus = network.open(network.robot())
    readers = []
    for subscription in (bus.subscribe(BY_NAME[topic]), bus.subscribe(BY_NAME[topic])):
        reader = threading.Thread(target=list, args=(subscription,), daemon=True)
        reader.start()
        readers.append((reader, subscription))
    readers[0][1].close()
    readers[0][1].close()
    readers[0][0].join(WAIT_S)
    bus.close()
    readers[1][0].join(WAIT_S)
    assert not any(reader.is_alive() for reader, _ in readers)


def test_subscriptions_are_back_after_a_restart_of_the_router() -> None:
    network = Network()
    robot = network.robot()
    arrived = arrival(network.open(robot), "people")
    publisher = network.open(robot)
    publish_until(arrived, publisher, EXAMPLES["Tracks"])
    publisher.publish(EXAMPLES["CameraInfo"])
    network.stop_router()
    network.start_router()
    arrived.clear()
    assert publish_until(arrived, publisher, EXAMPLES["Tracks"]) < 8.0
    # A new subscriber still gets the latched message from before the restart.
    Watcher(network.open(robot), CameraInfo).wait(CameraInfo)
    network.close()


def test_peers_stay_connected_without_the_router() -> None:
    network = Network()
    robot = network.robot()
    arrived = arrival(network.open(robot, "peer"), "people")
    publisher = network.open(robot, "peer")
    publish_until(arrived, publisher, EXAMPLES["Tracks"])
    network.stop_router()
    arrived.clear()
    publish_until(arrived, publisher, EXAMPLES["Tracks"])
    network.start_router()
    network.close()


def test_an_instance_is_announced_until_its_session_ends(network: Network) -> None:
    robot = network.robot()
    bus = network.open(robot)
    left, joined = threading.Event(), threading.Event()
    with zenoh.open(read_config(None, "client", network.environment)) as session:
        _subscriber = session.liveliness().declare_subscriber(
            f"people4d/v1/{robot}/alive/**",
            lambda sample: (joined if sample.kind == zenoh.SampleKind.PUT else left).set(),
            history=True,  # the token may exist before the subscription
        )
        bus.announce("detector", "detector-1")
        assert joined.wait(WAIT_S)
        assert not left.is_set()
        bus.close()
        assert left.wait(WAIT_S)


def test_missing_router_is_an_error_within_the_time_limit() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    start = time.monotonic()
    with pytest.raises(People4dError) as caught:
        ZenohBus(read_config(None, "client", {"PEOPLE4D_CONNECT": endpoint}), "robot", 0.5)
    assert 0.4 < time.monotonic() - start < 5.0
    text = str(caught.value)
    assert text.startswith(f'no Zenoh session with ["{endpoint}"] (it does not answer)')
    assert "Is the system up (people4d ps)" in text
    assert ".rs" not in text, "paths of the machine that built Zenoh"


def test_second_router_at_one_endpoint_is_an_error(network: Network) -> None:
    config = read_config(None, "router", {"PEOPLE4D_LISTEN": network.endpoint})
    with pytest.raises(People4dError, match=r"cannot listen .*in use.* Does another router") as e:
        ZenohBus(config, "robot")
    assert ".rs" not in str(e.value)


@pytest.mark.parametrize("name", ["", "a/b", "r*", "two words"])
def test_names_that_cannot_be_part_of_a_key_are_refused(network: Network, name: str) -> None:
    with pytest.raises(ConfigError, match="robot: expected 1 to 64 characters from"):
        network.open(name)
    with pytest.raises(ConfigError, match="instance: expected 1 to 64 characters from"):
        network.open(network.robot()).announce("detector", name)


def endpoints(config: zenoh.Config, name: str) -> list[str]:
    found: list[str] = json.loads(config.get_json(f"{name}/endpoints"))
    return found


def test_the_environment_wins_over_the_file() -> None:
    both = {"PEOPLE4D_CONNECT": "tcp/10.0.0.1:1,tcp/10.0.0.2:2", "PEOPLE4D_LISTEN": "tcp/0.0.0.0:3"}
    peer = read_config(None, "peer", both)
    assert endpoints(peer, "connect") == ["tcp/10.0.0.1:1", "tcp/10.0.0.2:2"]
    assert endpoints(peer, "listen") == ["tcp/0.0.0.0:3"]
    router = read_config(None, "router", both)
    assert endpoints(router, "listen") == ["tcp/0.0.0.0:3"]
    assert "tcp/10.0.0.1:1" not in str(router.get_json("connect/endpoints"))
    # A client on the router's host must not take the router's port.
    client = read_config(None, "client", both)
    assert "tcp/0.0.0.0:3" not in str(client.get_json("listen/endpoints"))


def test_the_file_is_the_given_one_else_that_of_the_environment(tmp_path: Path) -> None:
    files = []
    for name in ("a", "b"):
        files.append(tmp_path / f"{name}.json5")
        files[-1].write_text(f'{{mode: "client", connect: {{endpoints: ["tcp/{name}:1"]}}}}')
    environment = {"PEOPLE4D_ZENOH": str(files[1])}
    assert endpoints(read_config(files[0], "peer", environment), "connect") == ["tcp/a:1"]
    assert endpoints(read_config(None, "peer", environment), "connect") == ["tcp/b:1"]


def test_a_folder_holds_one_file_for_each_role(tmp_path: Path) -> None:
    for role in ("peer", "client"):
        text = f'{{mode: "{role}", connect: {{endpoints: ["tcp/{role}:1"]}}}}'
        (tmp_path / f"{role}.json5").write_text(text)
    environment = {"PEOPLE4D_ZENOH": str(tmp_path)}
    assert endpoints(read_config(None, "peer", environment), "connect") == ["tcp/peer:1"]
    assert endpoints(read_config(None, "client", environment), "connect") == ["tcp/client:1"]
    with pytest.raises(ConfigError, match=r"router\.json5 is not usable"):
        read_config(None, "router", environment)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (None, "is not usable: No such file"),
        ("{mode: 'pe", "is not usable: --> 1:11"),
        ("{mode: 'star'}", "is not usable: unknown variant `star`, expected one of `router`"),
        ("{connect: {endpoints: ['here']}}", "Endpoints must be of the form <protocol>/<address>"),
    ],
)
def test_bad_configuration_is_an_error_of_one_line(
    tmp_path: Path, content: str | None, problem: str
) -> None:
    path = tmp_path / "zenoh.json5"
    if content:
        path.write_text(content)
    with pytest.raises(ConfigError, match=re.escape(problem)) as caught:
        read_config(path, "peer", {})
    assert ".rs" not in str(caught.value)
    assert "\n" not in str(caught.value)
