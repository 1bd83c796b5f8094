"""Cameras of a tracker that are dead, covered or displaced: ps and doctor name them."""

import threading

import numpy as np
import pytest
from msgspec.structs import replace
from typer.testing import CliRunner

from common.geometry.transforms import rotation_from_rpy, transform_from
from common.transport.memory_bus import MemoryBus
from deploy.cli import app
from people4d.messages import Detections
from services.tracker.build import build
from services.tracker.config import TrackerConfig
from tests import builders
from tests.common.calibration.walks import WalkCamera, camera, messages, square, wander
from tests.network import Network

pytestmark = pytest.mark.network

PERIOD_NS = 200_000_000
STRIDE = 2  # step between used frames, which are at 10 Hz
USUAL_FRAMES = 110  # only a camera that found most people for a while can be covered
FAULTY_FRAMES = 100
WALK_S = 30.0  # duration of the repeated walk [s]
DEAD = "no detections arrive from camera d, while others send"
COVERED = "camera c detects no person in its view: is it covered?"
KNOCKED = "camera b has moved by about "


class WalkFeed:
    """Detections of two walkers by all cameras, fed to a tracker in memory.

    Args:
        cameras: Cameras at their true poses; the believed pose of the second is off by 6 degrees.
    """

    def __init__(self, cameras: list[WalkCamera]) -> None:
        self.dead, self.covered = set[str](), set[str]()
        self.count = 0  # number of sent frames of each camera
        self.tracker = build(TrackerConfig(embedding_wait_s=0.0))
        self._bus = MemoryBus([self.tracker])
        self._cameras = cameras
        self._frames = {one.name: list[Detections]() for one in cameras}
        for _, message in messages(cameras, [wander(3), wander(8)], WALK_S):
            if isinstance(message, Detections):
                self._frames[message.camera].append(message)
            else:
                self._bus.publish(message)

    def run(self, frames: int) -> str:
        """Send frames of each camera; return the reason of the tracker's health."""
        for _ in range(frames):
            for one in self._cameras:
                self._send(one)
            self.count += 1
            self._bus.advance(PERIOD_NS)
        status = self.tracker.status()
        assert status.state == "degraded"
        return status.reason

    def _send(self, one: WalkCamera) -> None:
        turn = rotation_from_rpy(0, 0, np.radians(6.0)) if one.name == "b" else np.eye(3)
        pose = one.map_from_camera
        believed = transform_from(pose[:3, 3], turn @ pose[:3, :3])
        if self.count % 5 == 0:
            child = f"{one.name}_optical_frame"
            self._bus.publish(builders.static_transform(believed, child=child))
        if one.name not in self.dead:
            frames = self._frames[one.name]
            frame = frames[STRIDE * self.count % len(frames)]
            people = () if one.name in self.covered else frame.detections
            stamp_ns = 10**12 + self.count * PERIOD_NS
            self._bus.publish(
                replace(frame, stamp_ns=stamp_ns, sequence=self.count, detections=people)
            )


def test_dead_covered_and_knocked_cameras_are_named(network: Network) -> None:
    corners = [WalkCamera(c.name, c.map_from_camera) for c in square("a", "b", "c", "d")]
    sides = [camera("e", 0.0, -3.6, 90.0), camera("f", 0.0, 3.6, -90.0)]
    feed = WalkFeed([*corners, *sides])
    assert KNOCKED in feed.run(USUAL_FRAMES)
    feed.dead.add("d")
    feed.covered.add("c")
    reason = feed.run(FAULTY_FRAMES)

    robot, ended = network.robot(), threading.Event()
    bus = network.open(robot)

    def beat() -> None:
        number = 0
        while not ended.wait(0.1):
            health = builders.health("tracker", state="degraded", reason=reason)
            bus.publish(replace(health, sequence=number))
            number += 1

    beating = threading.Thread(target=beat)
    beating.start()
    try:
        shown = run("ps", robot, network)
        examined = run("doctor", robot, network)
    finally:
        ended.set()
        beating.join()
    for said in (DEAD, COVERED, KNOCKED):
        assert said in reason
        assert said in shown, shown
        assert said in examined, examined
    assert "calibrate again" in examined


def run(command: str, robot: str, network: Network) -> str:
    """Return what a command prints, with the lines of its table joined."""
    result = CliRunner().invoke(
        app, [command, "--robot", robot, "--connect", network.endpoint], env={"COLUMNS": "1000"}
    )
    return " ".join(result.output.split())
