"""A program that pushes the frames of a running system's camera."""

import threading
from collections.abc import Iterator
from itertools import islice

import pytest

from people4d.errors import ConfigError, People4dError, SourceError
from people4d.messages import Tracks
from people4d_robot import Camera, Intrinsics, mount
from services.camera.source import SourceFrame
from services.camera.sources import open_source
from tests import DEMO
from tests.integration.system import ROBOT, System, running, shows_people
from tests.network import Network

pytestmark = [pytest.mark.processes, pytest.mark.network]

LENS = Intrinsics(fx=615.0, fy=615.0, cx=319.5, cy=239.5)
PERIOD_S, FRAMES = 1 / 15, 90
POSE = mount(z_m=1.15, rpy_rad=(0.0, 0.052, 0.0))


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[System]:
    with running(tmp_path_factory.mktemp("push"), source="push") as system:
        yield system


def test_pushed_frames_give_people(system: System) -> None:
    watcher, found = system.watch(Tracks), threading.Event()
    source = open_source(str(DEMO))
    frames = list(islice((one for one in source if isinstance(one, SourceFrame)), FRAMES))

    def push() -> None:
        for one in frames:
            if not found.wait(PERIOD_S):
                camera.push(one.rgb, one.depth_mm, one.stamp_ns)

    with Camera("front", LENS, POSE, robot=ROBOT, connect=system.connect) as camera:
        system.wait_alive("camera-front")
        with pytest.raises(ConfigError, match="camera-front runs already"):
            Camera("front", LENS, POSE, robot=ROBOT, connect=system.connect)
        thread = threading.Thread(target=push)
        thread.start()
        try:
            people = watcher.wait(Tracks, lambda m: shows_people(m) and len(m.tracks) == 3)
        finally:
            found.set()
            thread.join()
        with pytest.raises(SourceError, match="older than the one before"):
            camera.push(frames[0].rgb, frames[0].depth_mm, frames[0].stamp_ns)
        with pytest.raises(SourceError, match="depth is float64"):
            camera.push(frames[0].rgb, frames[0].rgb * 1.0, people.stamp_ns)
        assert camera.problem() == ""
    assert all(0.8 < track.position_m[2] < 1.6 for track in people.tracks)
    with pytest.raises(People4dError, match="camera front has ended: closed"):
        camera.push(frames[0].rgb, frames[0].depth_mm, people.stamp_ns)


def test_camera_without_a_system_names_the_command(
    network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("deploy.program.push.SYSTEM_S", 0.3)
    with pytest.raises(ConfigError, match="people4d up --source push"):
        Camera("front", LENS, connect=network.endpoint)
