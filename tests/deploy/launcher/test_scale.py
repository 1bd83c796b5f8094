"""Number of processes changed while the system runs, with a real supervisord."""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import psutil
import pytest

from deploy.compose import read, select
from deploy.launcher.health import Heartbeats
from deploy.launcher.launcher import Launcher, LaunchError, read_plan, stop
from deploy.launcher.plan import LaunchRequest, plan
from deploy.launcher.scaling import check_capacity, scale
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


@contextmanager
def running(folder: Path) -> Iterator[State]:
    """Run a system with one process per service."""
    state, file = State(folder / "robot"), folder / "compose.yaml"
    file.write_text(TOY)
    services = select(read(file, {}), set())
    launcher = Launcher(state, services, Heartbeats("", "robot"), lambda *_: None)
    launcher.start("robot", "tcp/127.0.0.1:1", TIMEOUT_S)
    try:
        yield state
    finally:
        stop(state)


@pytest.fixture(scope="module")
def state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[State]:
    """A system with one process of each service, unchanged by each test."""
    with running(tmp_path_factory.mktemp("state")) as state:
        yield state


def progress_of(state: State, *requests: str, force: bool = True) -> list[tuple[str, str]]:
    progress: list[tuple[str, str]] = []
    heartbeats = Heartbeats("", "robot")
    scale(state, requests, heartbeats, TIMEOUT_S, lambda *what: progress.append(what), force)
    return progress


def pids(state: State) -> dict[str, int]:
    return {name: process.pid for name, process in Supervisor(state).processes().items()}


def test_processes_are_added_and_stopped_beside_the_others(state: State) -> None:
    before = pids(state)
    assert set(before) == {"one-1", "many-1"}
    assert progress_of(state, "many=3") == [("many-2", "ready"), ("many-3", "ready")]
    three = pids(state)
    assert set(three) == {"one-1", "many-1", "many-2", "many-3"}
    assert all(three.values())
    assert three.items() > before.items()
    assert progress_of(state, "many=1") == [("many-2", "stopped"), ("many-3", "stopped")]
    assert pids(state) == before
    assert {s.name: s.replicas for s in read_plan(state)} == {"one": 1, "many": 1}
    assert progress_of(state) == []


def test_if_a_process_does_not_start_all_new_ones_are_stopped(state: State) -> None:
    before = pids(state)
    with pytest.raises(LaunchError, match="many-4 does not get ready"):
        progress_of(state, "many=5")
    assert pids(state) == before
    assert {s.name: s.replicas for s in read_plan(state)} == {"one": 1, "many": 1}


def test_more_replicas_than_cores_are_refused_unless_forced(state: State) -> None:
    cores = len(os.sched_getaffinity(0))
    with pytest.raises(ConfigError, match=f"this machine has {cores} cores"):
        progress_of(state, f"many={cores + 1}", force=False)
    with pytest.raises(ConfigError, match=f"many=999: this machine has {cores} cores"):
        progress_of(state, "many=999")
    assert set(pids(state)) == {"one-1", "many-1"}


def test_more_replicas_than_memory_holds_are_refused(state: State) -> None:
    services = read_plan(state)
    more = tuple(replace(s, replicas=8 if s.has("scalable") else 1) for s in services)
    processes = Supervisor(state).processes()
    check_capacity(services, more, processes, cores=8, free_mb=1000.0)
    with pytest.raises(ConfigError, match="that are free"):
        check_capacity(services, more, processes, cores=8, free_mb=1.0)


def test_hung_processes_are_stopped_within_ten_seconds(tmp_path: Path) -> None:
    with running(tmp_path) as state:
        progress_of(state, "many=3")
        hung = list(pids(state).values())
        for pid in hung:
            os.kill(pid, signal.SIGSTOP)
        start_s = time.monotonic()
        assert stop(state)
    assert time.monotonic() - start_s < 10.0
    assert not any(psutil.pid_exists(pid) for pid in hung)


def test_impossible_scale_is_rejected(state: State) -> None:
    with pytest.raises(ConfigError, match="unknown service 'singer'"):
        progress_of(state, "singer=2")
    moved = state.plan_file.rename(state.folder / "elsewhere")
    with pytest.raises(People4dError, match="cannot be read"):
        progress_of(state, "many=2")
    moved.rename(state.plan_file)


@pytest.mark.parametrize("name", ["router", "camera", "tracker", "gt_bridge"])
def test_service_without_replicas_runs_once(name: str) -> None:
    with pytest.raises(ConfigError, match=f"{name} runs once"):
        plan(LaunchRequest(scale=[f"{name}=2"], environment={}))
