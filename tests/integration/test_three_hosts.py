"""Commands of docs/launch/hosts.md on three hosts in network namespaces."""

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from common.io.recording import RecordingWriter, open_recording
from deploy.launcher.launcher import stop
from deploy.launcher.state import State
from people4d.messages import CompressedRgbdFrame, Tracks
from scripts.namespaces import ADDRESSES, Hosts, hosts, missing
from tests import DEMO, ROOT

pytestmark = pytest.mark.processes

BLOCK = re.compile(r"^```sh on=(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
HOSTS = ("tracker", "nuc")  # where something runs
CAMERA_HOSTS = {"nuc": "cam1", "tracker": "cam2", "planner": "cam3"}  # and their robot names
TIMEOUT_S = 100.0


def environment(host: str, home: Path) -> dict[str, str]:
    """Return the variables of a new login."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith("PEOPLE4D_")}
    bin_folder = str(Path(sys.executable).parent)
    return {
        **inherited,
        "PATH": f"{bin_folder}:{os.environ['PATH']}",
        "PEOPLE4D_STATE": str(home / host),  # they share this machine's disk
        "OMP_NUM_THREADS": "1",
    }


@pytest.fixture
def world(tmp_path: Path, state_folder: Path) -> Iterator[Hosts]:
    if why := missing():
        pytest.skip(why)
    for name in ("deploy", "docs"):
        (tmp_path / name).symlink_to(ROOT / name)
    with hosts() as world:
        try:
            yield world
        finally:
            names = [*((host, "robot") for host in HOSTS), *CAMERA_HOSTS.items(), ("nuc", "hall")]
            for host, name in names:  # their supervisord is reached by a file
                if (state_folder / host / name).exists():
                    stop(State(state_folder / host / name))


@pytest.mark.timeout(300)
def test_documented_commands_bring_tracks_to_the_planner(
    world: Hosts, tmp_path: Path, state_folder: Path
) -> None:
    blocks = BLOCK.findall((ROOT / "docs" / "launch" / "hosts.md").read_text(encoding="utf-8"))
    assert [host for host, _ in blocks] == ["nuc", "nuc", "tracker", "planner"]
    for host, text in blocks:
        try:
            printed = world.run(
                host,
                ["bash", "-ec", text],
                env=environment(host, state_folder),
                cwd=tmp_path,
                timeout=TIMEOUT_S,
            )
        except subprocess.CalledProcessError as error:
            pytest.fail(f"{host}: {text}\n{error.stdout}\n{error.stderr}")
    assert "people in map" in printed  # the last is the planner's


@pytest.mark.timeout(600)
def test_tracker_of_cameras_on_three_hosts_outlives_one(
    world: Hosts, tmp_path: Path, state_folder: Path
) -> None:
    def run(host: str, command: str) -> str:
        variables = environment(host, state_folder)
        command = f"set -e; export PEOPLE4D_KEYS=keys/{CAMERA_HOSTS[host]}; {command}"
        return world.run(
            host, ["bash", "-c", command], env=variables, cwd=tmp_path, timeout=TIMEOUT_S
        )

    write_slow(tmp_path / "slow.mcap")
    roles = "router,camera,detector,reid,watchdog,operator"
    addresses = [ADDRESSES[host] for host in CAMERA_HOSTS]
    keys = " ".join(f"--router {address}" for address in addresses)
    keys += "".join(f" --host {name}={roles},tracker" for name in CAMERA_HOSTS.values())
    run("nuc", f"people4d keys keys {keys}")
    for number, (host, name) in enumerate(CAMERA_HOSTS.items()):
        up = f"people4d up --compose deploy/hosts/two_cameras.yaml --host 0.0.0.0 --robot {name} -d"
        for camera, service in ((1, "camera"), (2, "camera_2")):
            for setting in ("source=slow.mcap", "loop=true", f"camera=c{2 * number + camera}"):
                up += f" --set {service}.{setting}"
        run(host, up)
    connect = ",".join(f"tcp/{address}:7447" for address in addresses)
    hosts_listed = ",".join(f'"{name}"' for name in CAMERA_HOSTS.values())
    area = f"export PEOPLE4D_CONNECT={connect}; people4d up --compose deploy/hosts/area.yaml -d "
    run("nuc", f"{area} --robot hall --set 'tracker.area.hosts=[{hosts_listed}]'")
    # One stream, through the router of another host than the tracker's.
    router = f"--robot hall --connect tcp/{ADDRESSES['tracker']}:7447"
    cameras = {f"c{number}" for number in range(1, 7)}
    assert heard(run, tmp_path, router, cameras) == cameras
    run("planner", "people4d down --robot cam3")
    assert heard(run, tmp_path, router, cameras - {"c5", "c6"}) >= cameras - {"c5", "c6"}
    printed = ""
    for _ in range(5):  # on a busy machine another host may be late for a moment
        printed = " ".join(run("tracker", f"people4d ps {router} || true").split())
        if "no detections arrive from host cam3" in printed:
            break
    assert "no detections arrive from host cam3" in printed


def write_slow(path: Path) -> None:
    """Write one frame a second of the demo."""
    with RecordingWriter(path) as writer:
        number = 0
        for log_ns, message in open_recording(DEMO).messages():
            if isinstance(message, CompressedRgbdFrame):
                number += 1
            if not isinstance(message, CompressedRgbdFrame) or number % 15 == 1:
                writer.write(message, log_ns)


def heard(run: Callable[[str, str], str], folder: Path, router: str, wanted: set[str]) -> set[str]:
    """Record people in intervals until messages of all cameras have arrived."""
    found = set[str]()
    for attempt in range(10):  # one frame a second and camera
        file = f"people{attempt}-{len(wanted)}.mcap"
        run("tracker", f"people4d record {file} {router} --topics people --seconds 3")
        recording = open_recording(folder / file)
        found = {m.camera for _, m in recording.messages(Tracks) if isinstance(m, Tracks)}
        if found >= wanted:
            break
    return found
