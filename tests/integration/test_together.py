"""Services together in one process and apart: the same people, the same handling of faults."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import pytest

from people4d.codec import encode
from people4d.messages import Health, Tracks
from tests import DEMO
from tests.integration.processes import pipeline
from tests.integration.system import SLOWLY, running, shows_people, works_again
from tests.network import Network, Watcher

pytestmark = [pytest.mark.processes, pytest.mark.network]

FRAMES = 12
WAITS = ("embedding_wait_s=20.0", "reorder_wait_s=20.0")  # on any machine, however slow
CAMERA = (f"source={DEMO}", f"max_frames={FRAMES}", "playback=lockstep", "answer_timeout_s=60.0")


def is_number(number: int) -> Callable[[Tracks], bool]:
    return lambda tracks: tracks.sequence == number


def is_of(service: str) -> Callable[[Health], bool]:
    return lambda health: health.service == service


def tracks(watcher: Watcher) -> list[bytes]:
    """Return the people of every frame, without their traces."""
    found = [watcher.wait(Tracks, is_number(k)) for k in range(FRAMES)]
    return [encode(msgspec.structs.replace(one, trace=())) for one in found]


def test_tracks_are_byte_for_byte_the_same_together_and_apart(
    network: Network, tmp_path: Path
) -> None:
    settings: dict[str, Sequence[str]] = {
        "tracker-1": WAITS,
        "reid-1": (),
        "detector-1": (),
        "camera-1": CAMERA,
    }
    robot = network.robot()
    watcher = Watcher(network.open(robot), Tracks)
    with pipeline(network, robot, settings, str(tmp_path / "apart")):
        apart = tracks(watcher)

    robot = network.robot()
    watcher = Watcher(network.open(robot), Tracks)
    command = [sys.executable, "-m", "deploy.joined", "--robot", robot]
    for instance, texts in settings.items():
        name = instance.partition("-")[0]
        command += [name, *(part for text in texts for part in ("--set", f"{name}.{text}"))]
    environment = {**os.environ, **network.environment, "OMP_NUM_THREADS": "1"}
    together = subprocess.Popen(command, env=environment)
    try:
        assert tracks(watcher) == apart
        assert together.wait(60) == 0  # the camera finished
    finally:
        together.kill()
        together.wait()
    assert any(len(payload) > 300 for payload in apart)  # people, not empty frames


def test_up_together_shows_each_service_and_replaces_the_process(state_folder: Path) -> None:
    with running(state_folder, *SLOWLY, "--together", "detector,reid,tracker") as system:
        pids = system.pids()
        assert pids["detector-1"] == pids["reid-1"] == pids["tracker-1"] != pids["camera-1"]
        watcher = system.watch(Health, Tracks)
        for service in ("detector", "reid", "tracker"):
            health = watcher.wait(Health, is_of(service))
            assert (health.instance, health.pid) == (f"{service}-1", pids["detector-1"])
        watcher.wait(Tracks, shows_people)
        killed = system.signal("reid", signal.SIGKILL)
        for service in ("detector", "reid", "tracker"):
            watcher.wait(Health, works_again(service, killed))
        watcher.wait(Tracks, shows_people)
