"""Diagnostics of faults caused in a system of real nodes."""

import contextlib
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import msgspec
import numpy as np
import pytest

from common.diagnosis.checks import examine
from common.diagnosis.evidence import Diagnostic, listen
from common.runtime.loop import Loop
from common.runtime.node import Node
from common.transport.trace import ProcessId
from people4d.client import Client
from people4d.codec import encode
from people4d.messages import U8, Detections, Message, RgbdFrame
from people4d.topics import BY_MESSAGE
from services.detector.config import DetectorConfig
from services.detector.models.base import DetectedPerson
from services.detector.node import DetectorNode
from services.tracker.build import build
from services.tracker.config import TrackerConfig
from tests import builders
from tests.contract.examples import BY_NAME
from tests.detector.bodies import body_network
from tests.detector.cameras import INFO
from tests.detector.test_node import FixedModel, frame, person
from tests.network import WAIT_S, Network

pytestmark = pytest.mark.network

PERIOD_NS = 100_000_000  # slow enough for a busy host
LISTEN_S = 0.6  # six heartbeats
POSE = builders.static_transform(np.eye(4), child=INFO.frame_id)


@dataclass
class Filming(Node):
    """A camera with 10 frames a second and configurable messages."""

    first: Sequence[Message] = (INFO, POSE)
    depth_mm: int = 2000
    periodic_outputs: ClassVar[tuple[type[Message], ...]] = (RgbdFrame,)
    sent: int = -1
    due_ns: int = 0

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        return ()

    def tick(self, now_ns: int) -> Sequence[Message]:
        if now_ns < self.due_ns:
            return ()
        self.due_ns, self.sent = now_ns + PERIOD_NS, self.sent + 1
        if self.sent == 0:
            return self.first
        image = frame(self.sent, self.depth_mm)
        return [msgspec.structs.replace(image, stamp_ns=self.sent * PERIOD_NS)]

    def wake_ns(self) -> int | None:
        return self.due_ns


class SlowModel(FixedModel):
    """A model that takes as long as five frames."""

    def detect(self, rgb: U8) -> list[DetectedPerson]:
        threading.Event().wait(5 * PERIOD_NS / 1e9)
        return super().detect(rgb)


class FailingModel(FixedModel):
    """A network that cannot be run."""

    def detect(self, rgb: U8) -> list[DetectedPerson]:
        raise RuntimeError("out of memory")


def detector(model: FixedModel | None = None) -> Node:
    return DetectorNode(
        model or FixedModel([person()]), DetectorConfig(), body_network=body_network()
    )


def tracker() -> Node:
    config = TrackerConfig(tracker="sort3d")
    return build(config)


@pytest.fixture(autouse=True)
def quick_heartbeat(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("common.runtime.heartbeat.PERIOD_S", 0.1)


class System:
    """Running nodes, and the doctor."""

    def __init__(self, network: Network, nodes: Sequence[tuple[str, Node]]) -> None:
        self.network, self.robot = network, network.robot()
        self.bus = network.open(self.robot)
        self._loops = []
        for instance, node in nodes:
            process_id = ProcessId(instance.partition("-")[0], instance, "robot")
            self._loops.append(Loop(node, network.open(self.robot), process_id))
        self._threads = [threading.Thread(target=loop.run) for loop in self._loops]
        for thread in self._threads:
            thread.start()

    def examine(self, check: str, robot: str = "") -> Diagnostic:
        """Listen until a check is not ok; it takes a moment to start."""
        with Client(self.network.endpoint, robot or self.robot, WAIT_S) as client:
            for _ in range(int(WAIT_S / LISTEN_S)):
                diagnostics = examine(listen(client, LISTEN_S))
                found = [f for f in diagnostics if f.check == check and f.level != "ok"]
                if found:
                    return found[0]
        raise AssertionError(f"nothing found but {diagnostics}")

    def close(self) -> None:
        for loop in self._loops:
            loop.stop()
        for thread in self._threads:
            thread.join(WAIT_S)


@contextlib.contextmanager
def running(network: Network, *nodes: tuple[str, Node]) -> Iterator[System]:
    system = System(network, nodes)
    try:
        yield system
    finally:
        system.close()


def test_good_system_wrong_robot_and_other_release(network: Network) -> None:
    nodes = [("camera-1", Filming()), ("detector-1", detector()), ("tracker-1", tracker())]
    with running(network, *nodes) as system:
        with Client(network.endpoint, system.robot, WAIT_S) as client:
            for _ in range(int(WAIT_S / LISTEN_S)):
                diagnostics = examine(listen(client, LISTEN_S))
                if {f.level for f in diagnostics} == {"ok"}:
                    break
        assert {f.level for f in diagnostics} == {"ok"}, diagnostics
        assert "of up to 1 people" in next(f.what for f in diagnostics if f.check == "output")
        # Asked for another name, the doctor names the running robot.
        assert system.examine("robot", "other").hint == f"Add --robot {system.robot}."
        # Detections of another release have a topic without an owner, so they are read.
        good = BY_NAME["Detections"]
        version = bytes([Detections.VERSION])
        other = encode(good).replace(b"\xa7version" + version, b"\xa7version\x7f")
        key = BY_MESSAGE[Detections].key_of(good, system.robot)
        with network.open(system.robot, timeout_s=WAIT_S)._session.declare_publisher(key) as saying:
            stop = threading.Event()

            def say() -> None:
                while not stop.wait(0.05):
                    saying.put(other)

            speaker = threading.Thread(target=say)
            speaker.start()
            try:
                assert (
                    f"expected version {Detections.VERSION}, got 127"
                    in system.examine("release").what
                )
            finally:
                stop.set()
                speaker.join()


@pytest.mark.parametrize(
    ("check", "camera", "model", "says"),
    [
        ("depth", Filming(depth_mm=0), None, "depth is all zero"),
        ("calibration", Filming(first=(POSE,)), None, "no CameraInfo arrives"),
        (
            "calibration",
            Filming(first=(builders.camera_info(width=80, height=60, fx=50.0), POSE)),
            None,
            "expected 80x60 as in its CameraInfo, got 40x60",
        ),
        ("people", Filming(), FixedModel([]), "the detector finds no person"),
        ("model", Filming(), FailingModel([]), "out of memory"),
        ("load", Filming(), SlowModel([person()]), "detector-1 is too slow"),
    ],
)
def test_each_fault_at_the_detector_is_found(
    network: Network, check: str, camera: Filming, model: FixedModel | None, says: str
) -> None:
    nodes = ("camera-1", replace(camera)), ("detector-1", detector(model))  # one camera an attempt
    with running(network, *nodes) as system:
        assert says in system.examine(check).what


def test_missing_transform_and_two_trackers_are_found(network: Network) -> None:
    nodes = [("camera-1", Filming(first=(INFO,))), ("detector-1", detector())]
    with running(network, *nodes, ("tracker-1", tracker()), ("tracker-2", tracker())) as system:
        assert f"map <- {INFO.frame_id}" in system.examine("transform").what
        assert "2 trackers publish people" in system.examine("twice").what


def test_silent_camera_is_found(network: Network) -> None:
    still = Filming()
    still.due_ns = 2**62
    with running(network, ("camera-1", still), ("detector-1", detector())) as system:
        assert "camera-1 sends no frames" in system.examine("frames").what


def test_nothing_runs(network: Network, tmp_path: Path) -> None:
    with running(network) as system:
        found = system.examine("services")
    assert found.what == "camera, detector, tracker does not run"
