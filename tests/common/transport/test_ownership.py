"""Keys that belong to one process: forged calibrations, transforms, zones and truth."""

import threading
from collections.abc import Callable
from typing import Any

import msgspec
import pytest
import zenoh

from common.transport import zenoh_bus
from common.transport.zenoh_bus import ZenohBus
from people4d.codec import encode
from people4d.messages import CameraInfo, Message, StaticTransform, Truth
from people4d.ownership import Announcements, KeyOwners
from people4d.queue import MessageQueue, RefusedPayload
from people4d.topics import BY_MESSAGE, BY_NAME
from tests.contract.examples import BY_NAME as EXAMPLES
from tests.network import WAIT_S, Network

INFO = BY_NAME["camera_info"]
KEY = "people4d/v1/robot/camera/front/info"
TOKEN = "people4d/v1/robot/alive/camera/camera-1"


def camera_info(**fields: Any) -> CameraInfo:
    info = msgspec.structs.replace(EXAMPLES["CameraInfo"], camera="front", **fields)
    assert isinstance(info, CameraInfo)
    return info


def owners_of(**tokens: str) -> KeyOwners:
    """Return the owners of calibrations, with announced sessions by their service."""
    announcements = Announcements()
    for service, session in tokens.items():
        announcements.update_token(f"people4d/v1/robot/alive/{service}/{service}-1/{session}", True)
    return KeyOwners(INFO, announcements)


def read(owners: KeyOwners, session: str, message: Message) -> str:
    """Return the fate of a message: "read", "refused" or "skipped"."""
    payloads = owners.receive(KEY, session, encode(message))
    if not payloads:
        return "skipped"
    return "refused" if isinstance(payloads[0], RefusedPayload) else "read"


def test_message_of_another_session_is_refused_while_the_owner_is_announced() -> None:
    owners = owners_of(camera="c1")
    assert read(owners, "c1", camera_info(fx=600.0)) == "read"
    assert read(owners, "x", camera_info(fx=400.0)) == "refused"
    assert read(owners, "", camera_info(fx=400.0)) == "refused"
    assert read(owners, "c1", camera_info(fx=610.0)) == "read"


def test_no_key_is_read_of_a_program_that_is_no_producer() -> None:
    # A transform of an invented frame may form a second link between two real frames.
    owners = owners_of(camera="c1", detector="d1")
    other = KEY.replace("front", "other")
    assert isinstance(owners.receive(other, "x", encode(camera_info()))[0], RefusedPayload)
    assert isinstance(owners.receive(other, "d1", encode(camera_info()))[0], RefusedPayload)
    payload = encode(camera_info())
    assert owners.receive(other, "c1", payload) == [payload]


def test_message_before_its_token_is_read_once_the_token_comes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("people4d.ownership.TOKEN_S", WAIT_S)
    owners, found = owners_of(camera="c1"), list[str]()
    reader = threading.Thread(target=lambda: found.append(read(owners, "c2", camera_info())))
    reader.start()
    owners._announcements.update_token(f"{TOKEN}/c2", True)
    reader.join(WAIT_S)
    assert found == ["read"]


def test_key_belongs_to_the_next_session_once_the_owner_is_gone() -> None:
    owners = owners_of(camera="c1")
    assert read(owners, "c1", camera_info(fx=600.0)) == "read"
    owners._announcements.update_token(f"{TOKEN}/c1", False)
    assert read(owners, "c2", camera_info(fx=600.0)) == "read"


def test_owner_regains_its_key_from_an_unannounced_session() -> None:
    owners = owners_of()
    assert read(owners, "x", camera_info(fx=400.0)) == "read"
    owners._announcements.update_token(f"{TOKEN}/c1", True)
    assert read(owners, "c1", camera_info(fx=600.0)) == "read"
    assert read(owners, "x", camera_info(fx=400.0)) == "refused"


def test_calibration_of_another_camera_process_is_refused() -> None:
    owners = owners_of(camera="c1")
    owners._announcements.update_token("people4d/v1/robot/alive/camera/camera-2/c2", True)
    assert read(owners, "c1", camera_info(fx=600.0)) == "read"
    assert read(owners, "c2", camera_info(fx=400.0)) == "refused"


def test_repetition_is_skipped_unless_another_message_came_between() -> None:
    owners = owners_of()
    assert read(owners, "c1", camera_info(fx=600.0)) == "read"
    assert read(owners, "c1", camera_info(fx=600.0)) == "skipped"
    assert read(owners, "c1", camera_info(fx=600.0, sequence=9)) == "read"
    assert read(owners, "x", camera_info(fx=400.0)) == "read"
    assert read(owners, "c1", camera_info(fx=600.0, sequence=9)) == "read"


def test_same_content_of_another_process_is_neither_read_nor_refused() -> None:
    # Two cameras of one robot publish the same mount of both.
    owners = owners_of(camera="c1")
    assert read(owners, "c1", camera_info(fx=600.0, stamp_ns=1, sequence=1)) == "read"
    assert read(owners, "c2", camera_info(fx=600.0, stamp_ns=2, sequence=2)) == "skipped"


def test_invented_keys_are_forgotten() -> None:
    owners = owners_of()
    payload = encode(camera_info(fx=400.0))
    for number in range(3 * INFO.keys_max):
        assert owners.receive(f"{KEY}{number}", "x", payload) == [payload]
    assert len(owners._accepted) <= 2 * INFO.keys_max


class Reader:
    """Values of a field in the messages that one session reads."""

    def __init__(self, bus: ZenohBus, kind: type[Message], value: Callable[[Any], float]) -> None:
        self.queue, self._value = MessageQueue(), value
        self.queue.follow(bus.subscribe(BY_MESSAGE[kind]), BY_MESSAGE[kind])

    def wait(self) -> float:
        """Return the next value."""
        arrival = self.queue.get(WAIT_S)
        assert arrival, dict(self.queue.counters)
        return self._value(arrival.message)

    def wait_for_refusal(self, topic: str, forge: Callable[[], None]) -> None:
        """Forge repeatedly until the message is refused."""
        for _ in range(int(WAIT_S / 0.05)):
            forge()
            if self.queue.counters[f"foreign_{topic}"]:
                return
            threading.Event().wait(0.05)
        raise TimeoutError("nothing was refused")


def announced(network: Network, robot: str, service: str) -> ZenohBus:
    bus = network.open(robot, "peer")
    bus.announce(service, f"{service}-1")
    return bus


@pytest.mark.network
@pytest.mark.parametrize("mode", ["client", "peer"])
def test_forged_calibration_is_refused_until_its_camera_ends(network: Network, mode: str) -> None:
    robot = network.robot()
    reader = Reader(network.open(robot, mode), CameraInfo, lambda info: info.fx)
    camera, other = announced(network, robot, "camera"), network.open(robot)
    camera.publish(camera_info(fx=600.0))
    assert reader.wait() == 600.0
    reader.wait_for_refusal("camera_info", lambda: other.publish(camera_info(fx=400.0)))
    assert "another process sends" in reader.queue.last_error
    camera.close()
    restarted = announced(network, robot, "camera")
    restarted.publish(camera_info(fx=601.0))
    values = [400.0]
    while values[-1] == 400.0:  # read between the two cameras, or not at all
        values.append(reader.wait())
    assert values[-1] == 601.0
    reader.wait_for_refusal("camera_info", lambda: other.publish(camera_info(fx=400.0)))


@pytest.mark.network
def test_calibration_in_the_name_of_the_camera_session_is_corrected_by_its_owner(
    network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zenoh_bus, "REPEAT_S", 0.3)
    robot = network.robot()
    listening = network.open(robot)
    reader = Reader(listening, CameraInfo, lambda info: info.fx)
    camera, other = announced(network, robot, "camera"), network.open(robot)
    camera.publish(camera_info(fx=600.0))
    assert reader.wait() == 600.0
    key = INFO.key_of(camera_info(), robot)
    samples = other._session.declare_subscriber(key, zenoh.handlers.RingChannel(1))
    source = samples.handler.recv().source_info
    assert source
    forged = zenoh.SourceInfo(source.source_id, source.source_sn + 1000)
    other._session.put(key, encode(camera_info(fx=400.0)), source_info=forged)
    assert reader.wait() == 400.0
    assert reader.wait() == 600.0
    assert camera.counters == {"foreign_camera_info": 1}
    late = Reader(network.open(robot), CameraInfo, lambda info: info.fx)
    assert late.wait() == 600.0


@pytest.mark.network
def test_forged_truth_is_refused(network: Network) -> None:
    robot = network.robot()
    reader = Reader(network.open(robot), Truth, lambda truth: float(truth.sequence))
    bridge, other = announced(network, robot, "gt_bridge"), network.open(robot)
    truth = msgspec.structs.replace(EXAMPLES["Truth"], sequence=1)
    bridge.publish(truth)
    assert reader.wait() == 1.0
    forged = msgspec.structs.replace(truth, sequence=2)
    reader.wait_for_refusal("truth", lambda: other.publish(forged))


@pytest.mark.network
def test_transform_of_another_camera_with_the_same_content_is_no_fault(network: Network) -> None:
    robot = network.robot()
    reader = Reader(network.open(robot), StaticTransform, lambda one: float(one.sequence))
    front, back = (announced(network, robot, "camera") for _ in range(2))
    mount = EXAMPLES["StaticTransform"]
    front.publish(msgspec.structs.replace(mount, sequence=1))
    assert reader.wait() == 1.0
    back.publish(msgspec.structs.replace(mount, sequence=2))
    front.publish(msgspec.structs.replace(mount, sequence=3))
    assert reader.wait() == 3.0
    assert reader.queue.counters["foreign_static_transforms"] == 0
