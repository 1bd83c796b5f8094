"""Both wheels in clean environments: a planner with the contract alone, a robot with the pipeline.

The index is a folder of both wheels. Links to the declared dependencies of a wheel, as they are
installed here, stand in for their download. The user's folder holds modules named like packages of
the project; these once replaced them.
"""

import contextlib
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import venv
import zipfile
from collections.abc import Mapping
from importlib.metadata import distribution
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from packaging.requirements import Requirement

from common.io.recording import RecordingWriter, open_recording
from common.transport.ports import free_port
from people4d.client import Client
from people4d.messages import Tracks
from services.tracker.build import TRACKERS
from tests import DEMO, ROOT, builders
from tests.network import Network

pytestmark = [pytest.mark.processes, pytest.mark.network]

PACKAGES = ("people4d", "common", "services", "cameras", "lab", "evaluation", "deploy", "models")
FILES = (
    *("pyproject.toml", "README.md", "LICENSE", "NOTICE"),
    *("people4d_command.py", "people4d_robot.py"),
)
CONTRACT_DEPENDENCIES = 4
SHADOWS = ("common", "services", "deploy", "lab")
TIMEOUT_S = 100.0
FRAMES = 45  # of the demo; tests/pipeline/test_demo_recording.py plays all
CONTRACT_MAX_BYTES = 200_000


def run(
    *command: str | Path, cwd: Path = ROOT, env: Mapping[str, str] = os.environ
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, check=False, capture_output=True, text=True, timeout=TIMEOUT_S, cwd=cwd, env=env
    )


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The wheels of the contract and of the pipeline."""
    source, built = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheels")
    for name in PACKAGES:
        ignore = shutil.ignore_patterns("__pycache__", "*.egg-info", "build")
        shutil.copytree(ROOT / name, source / name, ignore=ignore)
    for name in FILES:
        shutil.copy(ROOT / name, source / name)
    flags = ("--no-deps", "--no-build-isolation", "--no-index", "-q", "-w", built)
    done = run(sys.executable, "-m", "pip", "wheel", *flags, source / "people4d", source)
    assert done.returncode == 0, done.stderr
    (contract,), (pipeline,) = built.glob("people4d-*.whl"), built.glob("people4d_robot-*.whl")
    return contract, pipeline


def project(folder: str) -> dict[str, Any]:
    """Return the metadata of a distribution."""
    text = (ROOT / folder / "pyproject.toml").read_text()
    metadata: dict[str, Any] = tomllib.loads(text)["project"]
    return metadata


def link_dependencies(packages: Path, waiting: list[str]) -> None:
    """Link installed distributions, and the ones that they require."""
    linked = {"people4d"}
    while waiting:
        needed = Requirement(waiting.pop())
        if needed.name in linked or (needed.marker and not needed.marker.evaluate({"extra": ""})):
            continue
        linked.add(needed.name)
        found = distribution(needed.name)
        waiting += found.requires or ()
        for top in {file.parts[0] for file in found.files or ()} - {"..", "__pycache__"}:
            if not (packages / top).exists():
                (packages / top).symlink_to(Path(str(found.locate_file(top))))


def environment(folder: Path, index: Path, name: str, dependencies: list[str]) -> Path:
    """Install a distribution from a folder of wheels; return the programs."""
    venv.create(folder, with_pip=False, symlinks=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    link_dependencies(packages, dependencies)
    flags = ("install", "--no-index", "--no-compile", "-q", "--find-links", index)
    done = run(sys.executable, "-m", "pip", "--python", folder / "bin" / "python", *flags, name)
    assert done.returncode == 0, done.stderr
    return folder / "bin"


@pytest.fixture(scope="module")
def planner(tmp_path_factory: pytest.TempPathFactory, wheels: tuple[Path, Path]) -> Path:
    """Programs of an environment with the contract."""
    folder, dependencies = tmp_path_factory.mktemp("planner"), project("people4d")["dependencies"]
    return environment(folder, wheels[0].parent, "people4d", dependencies)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory, wheels: tuple[Path, Path]) -> Path:
    """Programs of an environment with the pipeline."""
    folder = tmp_path_factory.mktemp("robot")
    dependencies = [*project("people4d")["dependencies"], *project(".")["dependencies"]]
    return environment(folder, wheels[1].parent, "people4d-robot", dependencies)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A user's folder."""
    for name in SHADOWS:
        (tmp_path / f"{name}.py").write_text(f"raise ImportError('{name}.py of the user')\n")
    return tmp_path


def clean(**variables: str) -> Mapping[str, str]:
    unwanted = ("PYTHONPATH", "PYTHONSAFEPATH", "PEOPLE4D_PLUGINS")
    inherited = {name: value for name, value in os.environ.items() if name not in unwanted}
    return {**inherited, **variables}


def test_clone_beside_a_script_does_not_shadow_the_package(tmp_path: Path) -> None:
    (tmp_path / "people4d").mkdir()
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    program = ("-c", "from people4d import subscribe; import services.camera")
    done = run(sys.executable, *program, cwd=tmp_path, env=environment)
    assert done.returncode == 0, done.stderr


def test_planner_slows_down_for_a_person_beside_modules_named_like_ours(
    planner: Path, folder: Path
) -> None:
    # A person 3 m ahead who approaches at 2 m/s is 1 m away in a second.
    ahead, approach = np.array([3.0, 0.0, 1.0]), np.array([-2.0, 0.0, 0.0])
    person = builders.track(id=7, position_m=ahead, velocity_mps=approach, yaw_rad=np.pi)
    network = Network()
    shutil.copy(ROOT / "docs" / "examples" / "planner.py", folder)
    command: list[Path | str] = [planner / "python", folder / "planner.py", network.endpoint, "3"]
    try:
        bus = network.open("robot")
        with subprocess.Popen(command, cwd=folder, env=clean(), stdout=subprocess.PIPE) as process:
            while process.poll() is None:
                bus.publish(builders.tracks(person))
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(0.05)
            assert process.stdout
            lines = process.stdout.read().decode().splitlines()
        assert lines == ["#7 will be 1.00 m away: slow down"] * 3
    finally:
        network.close()


def test_wheel_of_the_contract_is_small_pure_and_holds_people4d_alone(
    wheels: tuple[Path, Path],
) -> None:
    contract, _ = wheels
    assert contract.name.endswith("-py3-none-any.whl")
    assert contract.stat().st_size < CONTRACT_MAX_BYTES
    with zipfile.ZipFile(contract) as archive:
        folders = {name.split("/")[0] for name in archive.namelist()}
    assert {name for name in folders if not name.endswith(".dist-info")} == {"people4d"}


def test_wheel_of_the_pipeline_holds_no_contract(wheels: tuple[Path, Path]) -> None:
    with zipfile.ZipFile(wheels[1]) as archive:
        assert not [name for name in archive.namelist() if name.startswith("people4d/")]


def test_both_distributions_have_one_version_and_name_each_other() -> None:
    contract, pipeline = project("people4d"), project(".")
    version = contract["version"]
    assert pipeline["version"] == version
    assert f"people4d=={version}" in pipeline["dependencies"]
    assert contract["optional-dependencies"]["robot"] == [f"people4d-robot=={version}"]
    assert len(contract["dependencies"]) == CONTRACT_DEPENDENCIES


def test_release_notes_and_citation_are_of_the_released_version() -> None:
    released = re.search(r"^## (\S+) \((\S+)\)", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert released
    assert released[1] == project(".")["version"]
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"version: {released[1]}\ndate-released: {released[2]}\n" in citation


def test_image_is_built_from_the_files_of_the_wheel() -> None:
    # Packages of all folders must be in the image.
    allowed = (ROOT / "deploy" / "Dockerfile.dockerignore").read_text().splitlines()
    copied = " ".join(re.findall("^COPY (.*)", (ROOT / "deploy" / "Dockerfile").read_text(), re.M))
    for name in (*PACKAGES, *FILES):
        assert f"!{name}" in allowed
        assert name in copied.split()


def test_types_are_declared(planner: Path) -> None:
    program = "import people4d, pathlib; print(pathlib.Path(people4d.__file__).parent)"
    done = run(planner / "python", "-c", program, env=clean())
    assert (Path(done.stdout.strip()) / "py.typed").is_file()


def test_pipeline_in_a_program_needs_the_wheels_alone(robot: Path, tmp_path: Path) -> None:
    shutil.copy(ROOT / "examples" / "in_process" / "arrays.py", tmp_path)
    (tmp_path / "deploy" / "demo").mkdir(parents=True)
    # Without the metadata of its simulation, which would compile the depth sensor first.
    with RecordingWriter(tmp_path / "deploy" / "demo" / DEMO.name) as writer:
        for log_ns, message in islice(open_recording(DEMO).messages(), 150):
            writer.write(message, log_ns)
    done = run(robot / "python", "arrays.py", cwd=tmp_path, env=clean())
    assert done.returncode == 0, done.stderr
    assert {line.split()[2] for line in done.stdout.splitlines()} >= {"#1", "#2"}


def test_pipeline_with_a_plug_in_runs_beside_modules_named_like_ours(
    robot: Path, folder: Path, state_folder: Path
) -> None:
    (folder / "people4d.py").write_text("raise ImportError('people4d.py of the user')\n")
    module, _, name = TRACKERS["sort3d"].partition(":")
    (folder / "mine.py").write_text(f"from {module} import {name} as Mine\n")
    port = free_port()
    variables = clean(PYTHONPATH=str(folder), PEOPLE4D_STATE=str(state_folder), OMP_NUM_THREADS="1")
    options = ("--detach", "--loop", "--port", str(port), "--tracker", "mine:Mine")
    try:
        done = run(robot / "people4d", "up", *options, "--source", DEMO, cwd=folder, env=variables)
        assert done.returncode == 0, done.stderr
        with Client(f"tcp/127.0.0.1:{port}") as client:
            assert next(client.messages(Tracks, timeout_s=90.0))
    finally:
        done = run(robot / "people4d", "down", cwd=folder, env=variables)
    assert done.returncode == 0, done.stderr


def test_demo_needs_the_wheels_alone(robot: Path, folder: Path, state_folder: Path) -> None:
    own = {"PEOPLE4D_STATE": str(state_folder), "PEOPLE4D_CAMERA_MAX_FRAMES": str(FRAMES)}
    variables = clean(OMP_NUM_THREADS="1", **own)
    command = (robot / "people4d", "demo", "--playback", "lockstep")
    done = run(*command, cwd=folder, env=variables)
    assert done.returncode in (0, 3), done.stdout + done.stderr  # 3: complete, with limits
    assert (folder / "out" / "demo" / "report.html").is_file()
    summary = json.loads((folder / "out" / "demo" / "summary.json").read_text())
    assert (summary["frames"], summary["frames_tracked"], summary["tracks"]) == (FRAMES, FRAMES, 3)
    assert (summary["score"]["id_switches"], summary["score"]["false_alarms"]) == (0, 0)
