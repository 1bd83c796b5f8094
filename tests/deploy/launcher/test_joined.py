"""Plans in which services share a process."""

import configparser
import shlex
from pathlib import Path

import pytest

from deploy import compose
from deploy.cli.system.logs import _files
from deploy.compose import Service
from deploy.joined import find
from deploy.launcher.joined import check_joinable
from deploy.launcher.plan import COMPOSE_FILE, LaunchRequest, plan
from deploy.launcher.state import State
from deploy.launcher.supervisor import render
from people4d.errors import ConfigError

THREE = ("detector", "reid", "tracker")


def planned(**fields: object) -> dict[str, Service]:
    launch = LaunchRequest(environment={}, **fields)  # type: ignore[arg-type]
    return {service.name: service for service in plan(launch)}


def programs(services: dict[str, Service]) -> configparser.RawConfigParser:
    parser = configparser.RawConfigParser(inline_comment_prefixes=(";", "#"), strict=False)
    parser.read_string(render(State(Path("/state/robot")), list(services.values())))
    return parser


def test_services_together_are_one_program_with_the_settings_of_each() -> None:
    settings = ["tracker.frame_id=odom", "detector.model=movenet-multipose"]
    services = planned(together=THREE, settings=settings)
    parser = programs(services)
    names = {name.partition(":")[2] for name in parser.sections() if name.startswith("program:")}
    joined = "detector-1+reid-1+tracker-1"
    assert names == {"router-1", "watchdog-1", "gt_bridge-1", "camera-1", joined}
    section = parser[f"program:{joined}"]
    arguments = shlex.split(section["command"].replace("%%", "%"))
    assert f"PEOPLE4D_INSTANCE={joined}" in arguments
    assert arguments[arguments.index("-m") + 1 :] == [
        *("deploy.joined", *THREE),
        *("--set", "detector.model=movenet-multipose"),
        *("--set", "tracker.frame_id=odom"),
    ]
    assert section["autorestart"] == "unexpected"
    assert section["stdout_logfile"] == f"/state/robot/{joined}.log"


def test_a_second_replica_has_a_process_of_its_own() -> None:
    parser = programs(planned(together=THREE, scale=["detector=2"]))
    assert "program:detector-2" in parser
    assert "program:detector-1" not in parser


def test_the_process_waits_for_what_any_of_them_waits_for(tmp_path: Path) -> None:
    services = planned(together=("camera", "detector"), report=tmp_path)
    names = list(services)
    for other in ("router", "reid", "tracker", "gt_bridge", "report"):
        for name in ("camera", "detector"):
            assert other in [d.service for d in services[name].depends_on]
            assert names.index(other) < names.index(name)
    assert "camera" not in [d.service for d in services["detector"].depends_on]
    assert programs(services)["program:camera-1+detector-1"]["autorestart"] == "false"


@pytest.mark.parametrize(
    ("together", "problem"),
    [
        (("detector",), "nothing to join"),
        (("detector", "reid", "detector"), "detector is named twice"),
        (("detector", "router"), "'router' cannot share a process"),
        (("detector", "watchdog"), "'watchdog' cannot share a process"),
        (("detector", "nothing"), "unknown service 'nothing'"),
        (("detector", "gait"), "gait is not enabled"),
    ],
)
def test_what_cannot_be_together_is_an_error(together: tuple[str, ...], problem: str) -> None:
    with pytest.raises(ConfigError, match=problem):
        planned(together=together)


def test_roles_that_are_proven_stay_apart() -> None:
    with pytest.raises(ConfigError, match="proves its role"):
        plan(LaunchRequest(environment={"PEOPLE4D_KEYS": "/keys"}, together=THREE))


def test_none_of_them_can_be_scaled_to_nothing() -> None:
    with pytest.raises(ConfigError, match="reid is in one process with detector, tracker"):
        planned(together=THREE, scale=["reid=0"])


def test_a_service_that_runs_another_program_cannot_be_together(tmp_path: Path) -> None:
    text = COMPOSE_FILE.read_text().replace(
        '"-m", "services.reid"]', '"-m", "services.reid", "--debug", "x"]'
    )
    file = tmp_path / "compose.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=r"reid does not run as python -m services\.reid"):
        planned(together=THREE, compose=file)


def test_every_service_that_can_be_together_is_found() -> None:
    joinable = [one.name for one in compose.read(COMPOSE_FILE, {}) if one.has("joinable")]
    builds = find(joinable)
    assert {"camera", "detector", "reid", "tracker", "events"} < set(joinable)
    assert [build.service for build in builds] == joinable
    assert all(build.config().__struct_fields__ for build in builds)
    with pytest.raises(ConfigError, match="'report' cannot share"):
        find(["report", "tracker"])


def test_the_log_is_found_under_each_name(tmp_path: Path) -> None:
    state = State(tmp_path)
    joined = tmp_path / "detector-1+reid-1.log"
    for file in (joined, tmp_path / "camera-1.log"):
        file.write_text("a line\n")
    assert state.log_of("reid-1") == joined
    assert state.log_of("camera-1") == tmp_path / "camera-1.log"
    assert _files(tmp_path, "reid") == [joined]
    assert _files(tmp_path, "detector-1") == [joined]


def test_containers_together_run_the_same_services() -> None:
    variables = {"PEOPLE4D_DETECTOR_MODEL": "x"}
    apart = {s.name: s for s in compose.read(COMPOSE_FILE, variables)}
    every = compose.read(COMPOSE_FILE.parent / "together.yaml", variables)
    together = {s.name: s for s in compose.select(every, set())}
    assert set(together) == {"router", "gt_bridge", "people", "camera"}
    assert together["router"] == apart["router"]
    people = together["people"]
    assert people.command == ("python", "-m", "deploy.joined", *THREE)
    names = ("detector-1", "reid-1", "tracker-1")
    assert people.environment["PEOPLE4D_INSTANCE"] == "+".join(names)
    for name in THREE:
        assert set(apart[name].environment) <= set(people.environment)
    check_joinable(people.command[3:], list(apart.values()), {})
