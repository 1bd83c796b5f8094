"""Nothing contacts another machine, asks a name server or leaves a file in the home folder."""

import sys
from pathlib import Path

import pytest

from common.transport.ports import free_port
from scripts.outward import homeless, left_files, missing, watch
from tests import ROOT

pytestmark = [
    pytest.mark.processes,
    pytest.mark.timeout(400),
    pytest.mark.skipif(bool(missing()), reason=missing()),
]

OPENVINO = """
from pathlib import Path
from common.inference.engines import open_session
open_session(Path("models/movenet-multipose.onnx"), engine="openvino")
"""
FOXGLOVE = """
from deploy.viewers.foxglove_messages import FoxgloveConverter
from deploy.viewers.foxglove_outputs import FoxgloveServer
FoxgloveServer(FoxgloveConverter(images=False), "127.0.0.1", 0).close()
"""
RERUN = f"""
import contextlib, subprocess
from deploy.viewers.rerun_viewer import start_viewer
viewer = start_viewer({free_port()}, headless=True)
with contextlib.suppress(subprocess.TimeoutExpired):  # it looks for a newer version meanwhile
    viewer.wait(3)
viewer.kill()
"""


def watched(home: Path, *arguments: str) -> tuple[int, list[str], list[str]]:
    """Return the exit code of a Python process, its outward contacts and its files."""
    environment = homeless(home) | {"PYTHONPATH": str(ROOT), "PEOPLE4D_CAMERA_MAX_FRAMES": "20"}
    code, contacts = watch([sys.executable, *arguments], environment)
    return code, [str(c) for c in contacts if c.outward], left_files(home)


def test_contacts_and_files_of_any_process_are_reported(tmp_path: Path) -> None:
    program = """
import pathlib, socket, subprocess, sys
pathlib.Path("~/device_id").expanduser().touch()
socket.socket(type=socket.SOCK_DGRAM).connect(("192.0.2.1", 53))  # which sends nothing
socket.create_server(("127.0.0.1", 0))
child = "import socket; socket.create_server(('0.0.0.0', 0))"
subprocess.run([sys.executable, "-c", child], check=True)
sys.exit(3)
"""
    code, outward, files = watched(tmp_path, "-c", program)
    assert code == 3
    assert sorted(line.partition(":")[0] for line in outward) == [
        "bind 0.0.0.0 port 0",
        "connect 192.0.2.1 port 53",
    ]
    assert files == ["device_id"]


def test_demo_contacts_this_machine_only(state_folder: Path, tmp_path: Path) -> None:
    demo = ("-m", "deploy.cli", "demo", "--playback", "lockstep", "--report", str(tmp_path))
    status, *found = watched(state_folder, *demo)
    assert status in (0, 3)  # 3: the run was degraded, as on a busy machine
    assert found == [[], []]


@pytest.mark.parametrize(
    ("package", "program"),
    [("openvino", OPENVINO), ("foxglove", FOXGLOVE), ("rerun", RERUN)],
    ids=["openvino", "foxglove", "rerun"],
)
def test_optional_packages_contact_this_machine_only(
    tmp_path: Path, package: str, program: str
) -> None:
    pytest.importorskip(package)
    assert watched(tmp_path, "-c", program) == (0, [], [])
