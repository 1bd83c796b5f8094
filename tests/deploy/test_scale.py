"""Number of processes changed while the system runs, with a real supervisord."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from deploy.compose import read, select
from deploy.launcher.health import Heartbeats
from deploy.launcher.launcher import Launcher, LaunchError, read_plan, scale, stop
from deploy.launcher.plan import LaunchRequest, plan
from deploy.launcher.state import State
from deploy.launcher.supervisor import Supervisor
from people4d.errors import ConfigError, People4dError

pytestmark = pytest.mark.processes

TIMEOUT_S = 10.0
TOY = """
services:
  one: {command: [sleep, "99"]}
  many:
    command: [sh, -c, "test $$PEOPLE4D_INSTANCE != many-4 && sleep 99"]
    restart: on-failure:1
    labels: {people4d.scalable: "true"}
"""


@pytest.fixture
def state(tmp_path: Path) -> Iterator[State]:
    """A running system of one process each."""
    state, file = State(tmp_path / "robot"), tmp_path / "compose.yaml"
    file.write_text(TOY)
    services = select(read(file, {}), set())
    launcher = Launcher(state, services, Heartbeats("", "robot"), lambda *_: None)
    launcher.start("robot", "tcp/127.0.0.1:1", TIMEOUT_S)
    yield state
    stop(state)


def progress_of(state: State, *requests: str) -> list[tuple[str, str]]:
    progress: list[tuple[str, str]] = []
    scale(state, requests, Heartbeats("", "robot"), TIMEOUT_S, lambda *what: progress.append(what))
    return progress


def pids(state: State) -> dict[str, int]:
    return {name: process.pid for name, process in Supervisor(state).processes().items()}


def test_processes_are_added_and_stopped_beside_the_others(state: State) -> None:
    before = pids(state)
    assert set(before) == {"one-1", "many-1"}
    assert progress_of(state, "many=3") == [("many-2, many-3", "ready")]
    three = pids(state)
    assert set(three) == {"one-1", "many-1", "many-2", "many-3"}
    assert all(three.values())
    assert three.items() > before.items()
    assert progress_of(state, "many=1") == [("many-2", "stopped"), ("many-3", "stopped")]
    assert pids(state) == before
    assert {s.name: s.replicas for s in read_plan(state)} == {"one": 1, "many": 1}
    assert progress_of(state) == []


def test_process_that_does_not_start_is_reported(state: State) -> None:
    with pytest.raises(LaunchError, match="many-4 does not get ready"):
        progress_of(state, "many=4")


def test_impossible_scale_is_rejected(state: State) -> None:
    with pytest.raises(ConfigError, match="there is no service 'singer'"):
        progress_of(state, "singer=2")
    state.plan_file.unlink()
    with pytest.raises(People4dError, match="cannot be read"):
        progress_of(state, "many=2")


@pytest.mark.parametrize("name", ["router", "camera", "tracker", "gt_bridge"])
def test_service_without_replicas_runs_once(name: str) -> None:
    with pytest.raises(ConfigError, match=f"{name} runs once"):
        plan(LaunchRequest(scale=[f"{name}=2"], environment={}))
