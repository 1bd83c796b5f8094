"""Supervisord's configuration equals the compose file."""

import configparser
import shlex
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from deploy.compose import Service
from deploy.launcher.state import LONGEST_SOCKET_PATH, State
from deploy.launcher.supervisor import local_command, quote, render
from people4d.errors import ConfigError


def service(**changes: object) -> Service:
    fields: dict[str, object] = {
        "name": "detector",
        "command": ("python", "-m", "services.detector"),
        "environment": {"A": "b c"},
        "depends_on": (),
        "has_healthcheck": False,
        "restart": "on-failure",
        "retries": 5,
        "replicas": 2,
        "stop_grace_s": 12.4,
        "profiles": frozenset(),
    }
    return Service(**{**fields, **changes})  # type: ignore[arg-type]


def sections(*services: Service) -> configparser.RawConfigParser:
    # Read as supervisord does.
    parser = configparser.RawConfigParser(inline_comment_prefixes=(";", "#"), strict=False)
    parser.read_string(render(State(Path("/state/robot")), services))
    return parser


def arguments(section: configparser.SectionProxy) -> list[str]:
    return shlex.split(section["command"].replace("%%", "%"))


def test_each_replica_is_a_program_with_its_own_name() -> None:
    parser = sections(service())
    first, second = parser["program:detector-1"], parser["program:detector-2"]
    assert arguments(first)[1:] == [
        "A=b c",
        "PEOPLE4D_RUN=/state/robot",
        "PEOPLE4D_STATE=/state",
        "PEOPLE4D_INSTANCE=detector-1",
        sys.executable,
        "-m",
        "services.detector",
    ]
    assert "PEOPLE4D_INSTANCE=detector-2" in arguments(second)
    assert first["stdout_logfile"] == "/state/robot/detector-1.log"
    assert first["stopwaitsecs"] == "12"


@pytest.mark.parametrize(
    ("restart", "retries", "expected"),
    [
        ("no", 0, ("false", "0", "0")),
        ("on-failure", 7, ("unexpected", "7", "1")),
        ("always", 5, ("true", "5", "1")),
        ("unless-stopped", 5, ("true", "5", "1")),
    ],
)
def test_restart_policies_of_compose_become_those_of_supervisord(
    restart: str, retries: int, expected: tuple[str, ...]
) -> None:
    program = sections(service(restart=restart, retries=retries))["program:detector-1"]
    assert (program["autorestart"], program["startretries"], program["startsecs"]) == expected


def test_programs_stop_in_reverse_order() -> None:
    parser = sections(service(name="router"), service(name="camera"))
    assert parser["program:router-1"]["priority"] == "1"
    assert parser["program:camera-1"]["priority"] == "2"


@settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow])  # of a busy machine
@given(st.lists(st.text(st.characters(exclude_characters="\n\r\0", codec="utf-8")), min_size=1))
def test_any_argument_round_trips_through_the_file(given_arguments: list[str]) -> None:
    parser = sections(service(command=("run", *given_arguments)))
    assert arguments(parser["program:detector-1"])[5:] == ["run", *given_arguments]


def test_argument_of_several_lines_is_rejected() -> None:
    with pytest.raises(ConfigError, match="more than one line"):
        quote("a\nb")


def test_python_and_people4d_are_those_of_this_environment() -> None:
    assert local_command(["python", "-c", "0"]) == [sys.executable, "-c", "0"]
    assert local_command(["people4d", "ps"]) == [sys.executable, "-m", "deploy.cli", "ps"]
    assert local_command(["other", "x"]) == ["other", "x"]


def test_too_long_socket_path_is_reported_before_the_start(tmp_path: Path) -> None:
    # 108 bytes hold a path, the 0 that ends it, and ".<pid>" while supervisord binds.
    name = "/supervisor.sock"
    long = tmp_path / ("x" * (LONGEST_SOCKET_PATH - len(str(tmp_path)) - len(name)))
    with pytest.raises(ConfigError, match="Set PEOPLE4D_STATE to a folder with a shorter path"):
        State(long).prepare()
    State(long.with_name(long.name[1:])).prepare()


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({"PEOPLE4D_STATE": "/s"}, "/s/r2"),
        ({"XDG_STATE_HOME": "/x"}, "/x/people4d/r2"),
        ({}, str(Path.home() / ".local/state/people4d/r2")),
    ],
)
def test_state_folder_follows_the_environment(environment: dict[str, str], expected: str) -> None:
    assert State.of_robot("r2", environment).folder == Path(expected)


def test_robot_name_with_a_path_is_rejected() -> None:
    with pytest.raises(ConfigError, match="robot: expected"):
        State.of_robot("../elsewhere", {})
