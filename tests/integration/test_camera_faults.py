"""Cameras of a running tracker that are dead, covered and knocked: ps and doctor name them."""

import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from typer.testing import CliRunner

from common.geometry.transforms import rotation_from_rpy, transform_from
from deploy.cli import app
from people4d.messages import Detections, Health
from tests import builders
from tests.common.calibration.walks import WalkCamera, camera, messages, square, wander
from tests.integration.processes import start
from tests.network import Network, Watcher

pytestmark = [pytest.mark.processes, pytest.mark.network]

PERIOD_S = 0.2
STRIDE = 2  # of the frames, which are ten a second
USUAL_FRAMES = 110
WALK_S = 30.0  # of the walk, which is repeated
DEAD = "nothing comes of camera d, while others send"
COVERED = "camera c finds none of the people before it: is it covered?"
KNOCKED = "camera b has moved by about "


class WalkFeed:
    """Publishes what cameras see of two people who walk, stamped when it is sent.

    Args:
        network: Router.
        robot: Name of the robot.
        cameras: Cameras where they are; the second is believed to look 6 degrees beside.
    """

    def __init__(self, network: Network, robot: str, cameras: list[WalkCamera]) -> None:
        self.dead, self.covered = set[str](), set[str]()
        self.count = 0  # of frames sent of each camera
        self._bus = network.open(robot)
        self._cameras = cameras
        self._frames = {one.name: list[Detections]() for one in cameras}
        for _, message in messages(cameras, [wander(3), wander(8)], WALK_S):
            if isinstance(message, Detections):
                self._frames[message.camera].append(message)
            else:
                self._bus.publish(message)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._ended.wait(PERIOD_S):
            for one in self._cameras:
                turn = rotation_from_rpy(0, 0, np.radians(6.0)) if one.name == "b" else np.eye(3)
                pose = one.map_from_camera
                believed = transform_from(pose[:3, 3], turn @ pose[:3, :3])
                child = f"{one.name}_optical_frame"
                if self.count % 5 == 0:
                    self._bus.publish(builders.static_transform(believed, child=child))
                if one.name in self.dead:
                    continue
                frames = self._frames[one.name]
                frame = frames[STRIDE * self.count % len(frames)]
                people = () if one.name in self.covered else frame.detections
                stamped = replace(
                    frame, stamp_ns=time.time_ns(), sequence=self.count, detections=people
                )
                self._bus.publish(stamped)
            self.count += 1

    def close(self) -> None:
        self._ended.set()
        self._thread.join()


def test_dead_covered_and_knocked_cameras_are_named(network: Network, state_folder: Path) -> None:
    corners = [WalkCamera(c.name, c.map_from_camera) for c in square("a", "b", "c", "d")]
    sides = [camera("e", 0.0, -3.6, 90.0), camera("f", 0.0, 3.6, -90.0)]
    robot = network.robot()
    watcher = Watcher(network.open(robot), Health)
    tracker = start(
        network, robot, "tracker-1", ["embedding_wait_s=0"], PEOPLE4D_STATE=str(state_folder)
    )
    feed = WalkFeed(network, robot, [*corners, *sides])
    try:
        # Only a camera that found most people for a while can be covered.
        wait(watcher, lambda reason: KNOCKED in reason and feed.count > USUAL_FRAMES)
        feed.dead.add("d")
        feed.covered.add("c")
        wait(watcher, lambda reason: DEAD in reason and COVERED in reason and KNOCKED in reason)
        shown = run("ps", robot, network)
        examined = run("doctor", robot, network)
        for said in (DEAD, COVERED, KNOCKED):
            assert said in shown, shown
            assert said in examined, examined
        assert "calibrate again" in examined
    finally:
        feed.close()
        tracker.kill()
        tracker.wait()


def wait(watcher: Watcher, condition: Callable[[str], bool]) -> None:
    """Wait for a reason of the tracker's health."""
    watcher.wait(Health, lambda h: h.state == "degraded" and condition(h.reason))


def run(command: str, robot: str, network: Network) -> str:
    """Return what a command prints, with the lines of its table joined."""
    result = CliRunner().invoke(
        app,
        [command, "--robot", robot, "--connect", network.endpoint],
        env={"COLUMNS": "1000"},
    )
    return " ".join(result.output.split())
