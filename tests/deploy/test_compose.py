"""Compose files: fields read, ignored and rejected."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from deploy.compose import Dependency, Service, read, select
from deploy.compose_file import interpolate
from deploy.launcher.plan import COMPOSE_FILE
from people4d.errors import ConfigError


def services_of(
    tmp_path: Path, text: str, variables: Mapping[str, str] | None = None, *profiles: str
) -> dict[str, Service]:
    file = tmp_path / "compose.yaml"
    file.write_text(text, encoding="utf-8")
    services = select(read(file, variables or {}), set(profiles))
    return {service.name: service for service in services}


def test_all_used_fields_are_read(tmp_path: Path) -> None:
    text = """
    x-env: &env {A: one, FLAG: true, N: 3, INHERITED: }
    services:
      first: {command: [run, "a b"], image: passed/over}
      second:
        command: [run, "a b", c]
        environment: {<<: *env, A: two}
        depends_on: {first: {condition: service_healthy}}
        healthcheck: {test: [CMD, people4d, health, second], interval: 30s, retries: 3}
        restart: on-failure:7
        deploy: {replicas: "2"}
        stop_grace_period: 3.5s
        profiles: [extra]
    """
    second = services_of(tmp_path, text, {}, "extra")["second"]
    assert second == Service(
        name="second",
        command=("run", "a b", "c"),
        environment={"A": "two", "FLAG": "true", "N": "3"},
        depends_on=(Dependency("first", "service_healthy", True),),
        has_healthcheck=True,
        restart="on-failure",
        retries=7,
        replicas=2,
        stop_grace_s=3.5,
        profiles=frozenset({"extra"}),
    )
    assert second.instances == ("second-1", "second-2")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("plain", "plain"),
        ("${SET}/${SET}", "v/v"),
        ("${MISSING}", ""),
        ("${MISSING:-d}", "d"),
        ("${EMPTY:-d}", "d"),  # ":" counts empty as missing
        ("${SET:-d}", "v"),
        ("$$SET $${SET}", "$SET ${SET}"),
        ("${MISSING:-tcp/router:7447}", "tcp/router:7447"),
        ("${RECURSIVE}", "${SET}"),  # values are not read again
    ],
)
def test_variables_are_replaced(text: str, expected: str) -> None:
    variables = {"SET": "v", "EMPTY": "", "RECURSIVE": "${SET}"}
    assert interpolate({"k": [text]}, variables) == {"k": [expected]}


@pytest.mark.parametrize(
    "text", ["${", "a $ b", "$A", "${A-b}", "${1X}", "${A:-${B}}", "${MISSING:?say it}"]
)
def test_bad_variables_are_rejected(text: str) -> None:
    with pytest.raises(ValueError, match=r"expected|say it"):
        interpolate(text, {})


def test_start_order_follows_dependencies(tmp_path: Path) -> None:
    text = """
    services:
      last: {command: [run], depends_on: [middle, first]}
      middle: {command: [run], depends_on: [first]}
      first: {command: [run]}
    """
    assert list(services_of(tmp_path, text)) == ["first", "middle", "last"]


def test_profiles_choose_services_and_optional_dependencies_go_with_them(tmp_path: Path) -> None:
    text = """
    services:
      extra: {command: [run], profiles: [extra]}
      main:
        command: [run]
        depends_on: {extra: {condition: service_started, required: false}}
    """
    without = services_of(tmp_path, text)
    assert list(without) == ["main"]
    assert without["main"].depends_on == ()
    with_it = services_of(tmp_path, text, {}, "extra")
    assert list(with_it) == ["extra", "main"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("services: {a: {command: [x], depends_on: [b]}}", "a depends on b, which does not run"),
        (
            "services: {a: {command: [x], depends_on: [b]}, b: {command: [x], depends_on: [a]}}",
            "services wait for each other: (a -> b -> a|b -> a -> b)",
        ),
        ("services: {a: {image: only}}", "a.command: expected a list"),
        ("services: {a: {command: [x], env_file: f}}", "a.env_file: this field has no meaning"),
        ("services: {a: {command: [x], deploy: {placement: {}}}}", "a.deploy.placement"),
        ("include: [other.yaml]", "include: this field has no meaning"),
        ("services: {a: {command: [x], restart: sometimes}}", "a.restart: expected one of"),
        ("services: {a: {command: [x], restart: 'on-failure:x'}}", "a.restart: expected one of"),
        ("services: {a: {command: [x], stop_grace_period: soon}}", "expected a duration"),
        ("services: {a: {command: [x], stop_grace_period: ''}}", "expected a duration"),
        ("services: {a: {command: [x], deploy: {replicas: many}}}", "replicas: expected a number"),
        ("services: {a: {command: 3}}", "a.command: expected a list"),
        ("services: [a]", "services: expected a map"),
        ("services: {off: {command: [x]}}", "services: expected text as a name, got False"),
        ("services: {a: {command: [x], environment: 3}}", "a.environment: expected a map"),
        ("services: {a: {command: [x], healthcheck: {test: [RUN, x]}}}", "a.healthcheck.test"),
        (
            "services: {a: {command: [x], depends_on: {b: {condition: happy}}}}",
            "a.depends_on.b: expected one of",
        ),
        ("services: {a: {command: [x]}", "is not YAML"),
        ("just text", "file: expected a map"),
    ],
)
def test_bad_files_are_rejected(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        services_of(tmp_path, text)


def test_missing_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read: No such file"):
        read(tmp_path / "none.yaml", {})


USUAL = {"router", "detector", "reid", "tracker", "gt_bridge", "camera"}
EVERYTHING = {  # profiles, each of the service of its name
    *("report", "gait", "visual_odometry", "predictor", "skeleton", "target", "ros2_bridge"),
    *("dashboard", "events", "site"),
}


def test_the_shipped_file_starts_the_camera_last() -> None:
    """No frame of a recording is lost if all listeners start before the camera."""
    services = select(read(COMPOSE_FILE, {}), EVERYTHING)
    assert services[0].name == "router"
    camera = services[-1]
    assert {service.name for service in services} == USUAL | EVERYTHING
    waited = {d.service for d in camera.depends_on if d.condition == "service_healthy"}
    assert waited == (USUAL | EVERYTHING) - {"camera"}
    assert camera.name == "camera"
    assert all(service.has_healthcheck for service in services)


EXTENDED = """
services:
  base: {command: [run, a], environment: {A: one, B: two}, depends_on: [other], profiles: [x]}
  other: {command: [run]}
"""


def test_a_service_extends_one_of_another_file(tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text(EXTENDED, encoding="utf-8")
    text = """
    services:
      mine:
        extends: {file: base.yaml, service: base}
        command: [run, b]
        environment: {B: three}
        depends_on: !reset null
        profiles: !override [y]
    """
    mine = services_of(tmp_path, text, {}, "y")["mine"]
    assert mine.command == ("run", "b")  # replaced, not appended to
    assert mine.environment == {"A": "one", "B": "three"}
    assert mine.depends_on == ()
    assert mine.profiles == {"y"}


@pytest.mark.parametrize(
    ("extends", "message"),
    [
        ("{file: base.yaml, service: none}", "base.yaml has no service 'none' to extend"),
        ("{file: gone.yaml, service: base}", "gone.yaml cannot be read"),
        ("{service: mine}", "mine.extends: expected a file and a service"),
        ("base", "mine.extends: expected a file and a service"),
    ],
)
def test_wrong_extends_is_rejected(tmp_path: Path, extends: str, message: str) -> None:
    (tmp_path / "base.yaml").write_text(EXTENDED, encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        services_of(tmp_path, f"services: {{mine: {{extends: {extends}}}}}")


def test_facts_of_services_are_labels_of_the_shipped_file() -> None:
    services = {service.name: service for service in read(COMPOSE_FILE, {})}
    assert {name for name, s in services.items() if s.has("scalable")} == {"detector", "reid"}
    assert services["gait"].option == "--gait"
    assert services["predictor"].option == "--predict"
    assert services["tracker"].option == ""
    assert services["tracker"].module == "services.tracker"
