"""Build the image without Docker and run the system with the options of both compose files.

Needs root on Debian with mmdebstrap, buildah, bubblewrap and iproute2, and Debian's packages. A
Debian root with Python stands in for the base image. Each service runs in bubblewrap with the
options of the compose file: read-only root, no capabilities, no new privileges, its user, tmpfs,
volumes, shared memory of the router, its environment and its health check. The network is one of
its own, which the services share. Prints a table; ends with 1 if a check fails.

    python -m scripts.containers FOLDER [--build-option=OPTION ...]
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from deploy import compose_file
from deploy.compose_file import interpolate
from deploy.launcher.plan import COMPOSE_FILE

ROOT = Path(__file__).resolve().parents[1]
BASE = "docker.io/library/python:3.11-slim"
PACKAGES = "python3,python3-venv,python-is-python3,ca-certificates"
INSIDE = "PEOPLE4D_CONTAINERS"  # environment variable inside the separate network
VARIABLES = {"PEOPLE4D_CAMERA_SOURCE": "/data/crossing.mcap", "PEOPLE4D_CAMERA_LOOP": "true"}
ORDER = ("router", "detector", "reid", "tracker", "gt_bridge", "camera")
ONE = "people4d"  # service of compose.yaml
DEMO = "people4d demo --playback lockstep --report /tmp/demo >&2; cat /tmp/demo/summary.json"
MESSAGES = 30
READY_S = 180.0
CLIENT_S = 120
ADDRESS = "172.30.0.2"  # address of the services, since Zenoh announces no loopback address
NETWORK = (
    "link set lo up",
    "link add eth0 type veth peer name eth1",
    f"address add {ADDRESS}/24 dev eth0",
    "link set eth0 up",
    "link set eth1 up",
)
CLIENT = f"""
import itertools
from people4d import subscribe
people = (len(m.tracks) for m in subscribe("tcp/router:7447") if m.tracks)
print(sum(1 for _ in itertools.islice(people, {MESSAGES})), flush=True)
"""


class Builder:
    """Builds the image with buildah.

    Args:
        folder: Folder of the images.
        options: Further options of `buildah build`.
    """

    def __init__(self, folder: Path, options: Sequence[str]) -> None:
        self._folder, self._options = folder, options

    def run(self, *arguments: str) -> str:
        """Run buildah and return its output."""
        storage = ["--storage-driver", "vfs", "--root", str(self._folder / "images")]
        storage += ["--runroot", str(self._folder / "run")]
        command = ["buildah", *storage, *arguments]
        environment = os.environ | {"BUILDAH_ISOLATION": "chroot"}
        done = subprocess.run(
            command, env=environment, check=True, cwd=ROOT, stdout=subprocess.PIPE, text=True
        )
        return done.stdout.strip()

    def build(self) -> tuple[Path, dict[str, str]]:
        """Return the root of a container of the image, and its environment."""
        if "people4d" not in self.run("images"):
            self._make_base()
            build = ["build", "--pull-never", "--file", "deploy/Dockerfile", *self._options]
            build += ["--ignorefile", "deploy/Dockerfile.dockerignore", "--target", "service"]
            self.run(*build, "--tag", "people4d", ".")
        container = self.run("from", "--pull-never", "localhost/people4d")
        root = Path(self.run("mount", container))
        for folder in root.parents:  # folders that the user of the services may pass
            if folder.is_relative_to(self._folder):
                folder.chmod(folder.stat().st_mode | 0o711)
        config = json.loads(self.run("inspect", "--type", "image", "localhost/people4d"))
        variables = config["OCIv1"]["config"]["Env"]
        return root, dict(variable.split("=", 1) for variable in variables)

    def _make_base(self) -> None:
        tar = self._folder / "base.tar"
        include = ["--variant=minbase", f"--include={PACKAGES}"]
        subprocess.run(["mmdebstrap", *include, "bookworm", str(tar)], check=True)
        base = self.run("from", "scratch")
        self.run("add", "-q", base, str(tar), "/")
        self.run("commit", "-q", base, BASE)


class Containers:
    """The services in bubblewrap.

    Args:
        root: Root of the image.
        image: Environment of the image.
        folder: Folder of volumes and logs.
        file: Compose file.
    """

    def __init__(self, root: Path, image: Mapping[str, str], folder: Path, file: Path) -> None:
        self._root, self._image, self._folder, self._file = root, image, folder, file
        document = compose_file.load(file)
        self._services = interpolate(document["services"], VARIABLES | dict(os.environ))
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self._shm = folder / "shm"
        self._shm.mkdir(mode=0o1777, exist_ok=True)
        self._shm.chmod(0o1777)
        (root / "etc" / "hosts").write_text(f"127.0.0.1 localhost\n{ADDRESS} router\n")

    def start(self, name: str) -> None:
        """Start a service."""
        with (self._folder / f"{name}.log").open("wb") as log:
            self.processes[name] = subprocess.Popen(
                self._command(name, self._services[name]["command"]), stdout=log, stderr=log
            )

    def run(self, name: str, *command: str) -> "subprocess.CompletedProcess[str]":
        """Run a command with the options of a service."""
        limited = ["timeout", str(CLIENT_S), *self._command(name, command)]
        return subprocess.run(limited, capture_output=True, check=False, text=True)

    def wait_healthy(self, name: str) -> bool:
        """Run the health check of a service until it passes; return False after a timeout."""
        check = self._services[name]["healthcheck"]["test"][1:]
        end_s = time.monotonic() + READY_S
        while time.monotonic() < end_s and self.processes[name].poll() is None:
            if self.run(name, *check).returncode == 0:
                return True
            time.sleep(1.0)
        return False

    def close(self) -> None:
        """End all, last started first."""
        for process in reversed(self.processes.values()):
            process.terminate()
        for process in self.processes.values():
            process.wait(20)

    def _command(self, name: str, command: Sequence[str]) -> list[str]:
        service = self._services[name]
        user = service["user"]
        assert service["read_only"]
        assert service["cap_drop"] == ["ALL"]
        options = [
            "--clearenv",
            "--ro-bind",
            str(self._root),
            "/",
            "--proc",
            "/proc",
            "--dev",
            "/dev",
        ]
        options += ["--bind", str(self._shm), "/dev/shm"]
        for mount in service["tmpfs"]:
            options += ["--perms", "1777", "--tmpfs", mount.partition(":")[0]]
        for volume in service["volumes"]:
            options += self._volume(volume)
        variables = {**self._image, "HOME": "/home/people4d", **_given(service["environment"])}
        for key, value in variables.items():
            options += ["--setenv", key, value]
        options += ["--unshare-user", "--unshare-pid", "--die-with-parent"]
        options += ["--chdir", "/people4d"]
        drop = ["setpriv", "--reuid", user, "--regid", user, "--clear-groups", "--no-new-privs"]
        drop += ["--inh-caps=-all", "--bounding-set=-all"]
        return [*drop, "bwrap", *options, "--", *command]

    def _volume(self, volume: str) -> list[str]:
        source, inside, *mode = volume.split(":")
        named = source == "state"
        outside = self._folder / source if named else (self._file.parent / source).resolve()
        target = self._root / inside.lstrip("/")
        if named and not outside.exists():  # takes owner and mode from the folder in the image
            shutil.copytree(target, outside)
            status = target.stat()
            os.chown(outside, status.st_uid, status.st_gid)
            outside.chmod(status.st_mode & 0o7777)
        if outside.is_dir():  # a mount point is created, as by container runtimes
            target.mkdir(parents=True, exist_ok=True)
        else:
            target.touch()
        return ["--ro-bind" if mode == ["ro"] else "--bind", str(outside), inside]


def _given(environment: Mapping[str, Any]) -> dict[str, str]:
    """Return the variables of a service; the caller's replace missing values."""
    given = {key: VARIABLES.get(key) if v is None else str(v) for key, v in environment.items()}
    return {key: value for key, value in given.items() if value is not None}


def checks(running: Containers) -> list[tuple[str, str, bool]]:
    """Start all services and return each check, its result, and whether it passed."""
    found = []
    for name in ORDER:
        running.start(name)
        healthy = running.wait_healthy(name)
        found.append((f"{name}: health check of the compose file", "", healthy))
    received = running.run("tracker", "python", "-c", CLIENT)
    count = received.stdout.strip()
    found.append(("messages with people, to a planner's code", count, count == f"{MESSAGES}"))
    status = running.run("tracker", "cat", "/proc/self/status").stdout
    fields = dict(line.split(":\t", 1) for line in status.splitlines() if ":\t" in line)
    for field, wanted in (("Uid", "10001"), ("CapEff", "0" * 16), ("NoNewPrivs", "1")):
        value = fields[field].split()[0]
        found.append((f"{field} of a process", value, value == wanted))
    for path in ("/people4d", "/opt/venv", "/data", "/etc"):
        refused = running.run("tracker", "touch", f"{path}/written").returncode != 0
        found.append((f"writing to {path}", "refused" if refused else "possible", refused))
    for path in ("/tmp", "/home/people4d/.local/state/people4d"):
        written = running.run("tracker", "touch", f"{path}/written").returncode == 0
        found.append((f"writing to {path}", "possible" if written else "refused", written))
    running.processes["tracker"].kill()
    running.processes["tracker"].wait()
    running.start("tracker")
    healthy = running.wait_healthy("tracker")
    state = "/home/people4d/.local/state/people4d"
    names = running.run("tracker", "find", state, "-name", "*.checkpoint", "-user", "10001")
    files = len(names.stdout.split())
    found.append(
        (
            "tracker after SIGKILL, its state from the volume",
            f"{files} files",
            healthy and files > 0,
        )
    )
    return found


def main() -> int:
    """Build, run, print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="for images, volumes and logs; used again")
    parser.add_argument("--build-option", action="append", default=[], help="of buildah build")
    options = parser.parse_args()
    folder = options.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    if INSIDE not in os.environ:
        root, image = Builder(folder, options.build_option).build()
        inside = json.dumps([str(root), image])
        again = ["unshare", "--net", sys.executable, "-m", "scripts.containers", str(folder)]
        return subprocess.run(again, env=os.environ | {INSIDE: inside}, check=False).returncode
    for arguments in NETWORK:
        subprocess.run(["ip", *arguments.split()], check=True)
    root, image = json.loads(os.environ[INSIDE])
    running = Containers(Path(root), image, folder, COMPOSE_FILE)
    try:
        found = checks(running)
    finally:
        running.close()
    together = Containers(Path(root), image, folder, ROOT / "compose.yaml")
    try:
        together.start(ONE)
        healthy = together.wait_healthy(ONE)
    finally:
        together.close()
    found.append(("all services in one container: health check", "", healthy))
    summary = json.loads(together.run(ONE, "sh", "-c", DEMO).stdout)
    figures = f"{summary['tracks']} people, {summary['score']['id_switches']} switches"
    found.append(("the demo in that container", figures, figures == "3 people, 0 switches"))
    print("| check | found | |", "| --- | --- | --- |", sep="\n")
    for what, got, good in found:
        print(f"| {what} | {got} | {'as wanted' if good else 'FAILED'} |")
    return 0 if all(good for *_, good in found) else 1


if __name__ == "__main__":
    sys.exit(main())
