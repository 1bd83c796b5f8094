"""Dockerfile, compose files and CI, as far as they can be checked without Docker."""

import re
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest
import typer.main
from typer.core import TyperGroup

from deploy import compose_file
from deploy.cli import app
from deploy.compose import read
from deploy.compose_file import interpolate
from deploy.launcher.plan import COMPOSE_FILE

DEPLOY = COMPOSE_FILE.parent
ROOT = DEPLOY.parent
DOCKERFILE = DEPLOY / "Dockerfile"
HOST_FILES = sorted((DEPLOY / "hosts").glob("*.yaml"))
STANDALONE = DEPLOY / "standalone.yaml"
ONE_CONTAINER = [STANDALONE, ROOT / "compose.yaml"]
FILES = [COMPOSE_FILE, *HOST_FILES, *ONE_CONTAINER]
VARIABLES = {"PEOPLE4D_KEYS": "keys", "PEOPLE4D_CONNECT": "tcp/192.168.1.7:7447"}


def services(file: Path) -> dict[str, dict[str, Any]]:
    """Return the services of a compose file as Docker reads them without other settings."""
    document = compose_file.load(file)
    found: dict[str, dict[str, Any]] = interpolate(document["services"], VARIABLES)
    return found


ALL_SERVICES = [
    pytest.param(service, id=f"{file.parent.name}/{file.name}-{name}")
    for file in FILES
    for name, service in services(file).items()
]


def instructions() -> list[tuple[str, str]]:
    """Return instruction and argument of each line of the Dockerfile, continued ones joined."""
    text = re.sub(r"^#.*\n", "", DOCKERFILE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    lines = text.replace("\\\n", " ").splitlines()
    return [(line.split()[0], line.split(maxsplit=1)[1]) for line in lines if line.strip()]


@pytest.mark.parametrize("service", ALL_SERVICES)
def test_containers_have_no_extra_rights(service: dict[str, Any]) -> None:
    assert service["user"] not in ("", "0", "root")
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert not {"privileged", "cap_add", "devices", "pid"} & service.keys()


@pytest.mark.parametrize("service", ALL_SERVICES)
def test_every_container_can_run_and_be_watched(service: dict[str, Any]) -> None:
    assert service["init"] is True  # reaps, and passes signals on
    assert service["ulimits"] == {"memlock": -1}  # Zenoh locks its shared memory
    assert service["restart"].startswith("on-failure")
    assert [mount.partition(":")[0] for mount in service["tmpfs"]] == ["/tmp"]
    check = service["healthcheck"]
    assert check["test"][:3] == ["CMD", "people4d", "health"]
    assert {"interval", "timeout", "retries", "start_period", "start_interval"} <= check.keys()


STATE = "state:/home/people4d/.local/state/people4d"


@pytest.mark.parametrize("service", ALL_SERVICES)
def test_only_reports_and_state_can_be_written(service: dict[str, Any]) -> None:
    for volume in service["volumes"]:
        if volume == STATE:
            continue
        _, inside, *mode = volume.rsplit(":", 2 if volume.endswith(":ro") else 1)
        assert mode == ["ro"] or inside == "/out", volume


@pytest.mark.parametrize("service", ALL_SERVICES)
def test_state_is_on_a_volume_that_the_user_of_the_image_may_write(service: dict[str, Any]) -> None:
    assert STATE in service["volumes"]
    folder = STATE.partition(":")[2]
    assert service["environment"]["PEOPLE4D_STATE"] == folder
    made = [text for name, text in instructions() if name == "RUN" and folder in text]
    assert made
    assert "--mode=1777" in made[0]


@pytest.mark.parametrize("file", FILES, ids=lambda file: f"{file.parent.name}/{file.name}")
def test_shared_memory_is_that_of_one_service_and_large_enough(file: Path) -> None:
    found = services(file)
    for name, service in found.items():
        owner = service.get("ipc", "").partition("service:")[2]
        if owner:
            assert found[owner]["ipc"] == "shareable"
            assert owner in service["depends_on"]
        else:
            assert service["shm_size"]
            assert name == "router" or "router" not in found


@pytest.mark.parametrize("file", HOST_FILES, ids=lambda file: file.name)
def test_services_of_hosts_equal_those_of_compose_yaml(file: Path) -> None:
    shipped = services(COMPOSE_FILE)
    for number, service in services(file).items():
        name = number.removesuffix("_2")  # a second camera
        for field in ("command", "healthcheck", "init", "restart", "stop_grace_period", "user"):
            assert service[field] == shipped[name][field], f"{name}.{field}"
        added = {"PEOPLE4D_KEYS", "PEOPLE4D_MODE", "PEOPLE4D_PRIVACY"}
        assert service["environment"].keys() - added <= shipped[name]["environment"].keys()


@pytest.mark.parametrize("file", HOST_FILES, ids=lambda file: file.name)
def test_hosts_require_keys(file: Path) -> None:
    with pytest.raises(Exception, match="variable PEOPLE4D_KEYS is not set"):
        read(file, VARIABLES | {"PEOPLE4D_KEYS": ""})
    for service in services(file).values():
        assert service["environment"]["PEOPLE4D_KEYS"] == "/keys"
        assert "keys:/keys:ro" in service["volumes"]
        assert service["network_mode"] == "host"  # images stay on the host by their interface


@pytest.mark.parametrize(
    ("files", "more"),
    [(("nuc", "tracker"), {"gait", "visual_odometry"}), (("two_cameras", "area"), {"camera_2"})],
)
def test_hosts_together_run_the_pipeline(files: tuple[str, ...], more: set[str]) -> None:
    running = [name for file in files for name in services(DEPLOY / "hosts" / f"{file}.yaml")]
    pipeline = {"router", "watchdog", "camera", "detector", "reid", "tracker"}
    assert set(running) == pipeline | more
    for name in set(running) - {"watchdog"}:
        assert running.count(name) == 1


@pytest.mark.parametrize("file", ONE_CONTAINER, ids=lambda file: file.name)
def test_one_container_runs_up_with_known_options(file: Path) -> None:
    (service,) = services(file).values()
    program, name, *options = service["command"]
    group = typer.main.get_command(app)
    assert isinstance(group, TyperGroup)
    context = group.commands[name].make_context(name, options)
    assert (program, name, context.params["source_"]) == ("people4d", "up", "demo")
    for port in service["ports"]:
        assert port.startswith("127.0.0.1:")


def test_standalone_file_installs_the_released_version() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    (service,) = services(STANDALONE).values()
    installed = re.findall(r"people4d-robot\[([\w,]+)\]==([\d.]+)", str(service["build"]))
    ((extras, version),) = installed
    assert version == project["version"] == service["image"].partition(":")[2]
    assert set(extras.split(",")) <= project["optional-dependencies"].keys()


def test_compose_files_of_ci_exist() -> None:
    text = (ROOT / ".github" / "workflows" / "ci.yml").read_text("utf-8")
    named = re.findall(r"\S+\.yaml", text)
    assert {"deploy/compose.yaml", "deploy/standalone.yaml"} <= set(named)
    for file in named:
        assert list(ROOT.glob(file)), file


def test_image_runs_without_root() -> None:
    stages = "\n".join(f"{name} {rest}" for name, rest in instructions()).split("FROM ")
    (service,) = (stage for stage in stages if " AS service" in stage)
    (user,) = re.findall(r"^USER (\S+)", service, re.MULTILINE)
    assert user.isdecimal()  # a number, so that Kubernetes recognises that it is not root
    assert user != "0"


def test_image_installs_pinned_versions() -> None:
    stages: set[str] = set()
    for name, rest in instructions():
        assert name not in ("ADD", "MAINTAINER")
        if name == "FROM":
            image, _, stage = rest.partition(" AS ")
            assert image in stages or re.fullmatch(r"[a-z/]+:\d+\.\d+-[a-z]+", image), image
            stages.add(stage)
        if name == "RUN" and "pip install" in rest:
            assert "--require-hashes" in rest or "--no-deps" in rest
        if name in ("CMD", "ENTRYPOINT"):
            assert rest.startswith("[")  # a shell would keep SIGTERM to itself
        if name == "WORKDIR":
            assert rest.startswith("/")
        assert "sudo" not in shlex.split(rest, comments=False)


def test_files_copied_into_the_image_exist() -> None:
    for name, rest in instructions():
        if name == "COPY" and "--from" not in rest:
            for source in rest.split()[:-1]:
                assert (ROOT / source).exists(), source
