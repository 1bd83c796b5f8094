"""Services that supervisord forks with loaded modules, and services that it executes."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import psutil
import pytest

from deploy.launcher.launcher import stop
from deploy.launcher.prefork import module_of, split
from deploy.launcher.state import State
from deploy.launcher.supervisor import Supervisor
from tests.deploy.launcher.test_supervisor import service

TIMEOUT_S = 40.0
MAIN = """
import json, os, pathlib, signal, sys, time
facts = {
    "argv": sys.argv, "main": __name__, "forked": "supervisor" in sys.modules,
    "instance": os.environ.get("PEOPLE4D_INSTANCE"), "pid": os.getpid(),
    "handler": signal.getsignal(signal.SIGTERM) == signal.SIG_DFL,
}
file = pathlib.Path(os.environ["FACTS"]) / os.environ["PEOPLE4D_INSTANCE"]
file.with_suffix(".new").write_text(json.dumps(facts))
file.with_suffix(".new").rename(file)
end = sys.argv[1] if len(sys.argv) > 1 else ""
if end == "raise":
    raise ValueError("no such model")
if end:
    sys.exit(int(end) if end.isdigit() else end)
time.sleep(99)
"""
THREADED = "import threading, time\nthreading.Thread(target=time.sleep, args=(99,)).start()\n"


def test_command_of_a_program_is_split_into_variables_and_module() -> None:
    command = [sys.executable, "-m", "services.detector", "--set", "a=b"]
    variables, rest = split(["/usr/bin/env", "A=b=c", "B=", *command])
    assert (variables, rest) == ({"A": "b=c", "B": ""}, command)
    assert module_of(rest) == "services.detector"
    for other in ([], ["sleep", "9"], [sys.executable, "-c", "0"], ["python", "-m", "services.x"]):
        assert module_of(other) == ""


@pytest.fixture
def state(tmp_path: Path) -> Iterator[State]:
    state = State(tmp_path / "robot")
    yield state
    stop(state)


def started(
    state: State, monkeypatch: pytest.MonkeyPatch, programs: Mapping[str, str], *commands: str
) -> Supervisor:
    """Start modules, each with its arguments, as services one, two, ..."""
    folder = state.folder.parent
    for name, build in programs.items():
        (folder / name).mkdir()
        for file, text in (("__init__", ""), ("build", build), ("__main__", MAIN)):
            (folder / name / f"{file}.py").write_text(text)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    state.prepare()
    supervisor = Supervisor(state)
    names = ("one", "two", "three")
    supervisor.spawn(
        [
            service(
                name=name,
                command=("python", "-m", *command.split()),
                environment={"FACTS": str(folder)},
                replicas=1,
                restart="no",
            )
            for name, command in zip(names, commands, strict=False)
        ]
    )
    for name in names[: len(commands)]:
        supervisor.start(f"{name}-1")
    return supervisor


def facts_of(state: State, instance: str) -> dict[str, Any]:
    file = state.folder.parent / instance
    deadline_s = time.monotonic() + TIMEOUT_S
    while not file.exists():
        assert time.monotonic() < deadline_s, state.log_of(instance).read_text()
        time.sleep(0.02)
    found: dict[str, Any] = json.loads(file.read_text())
    return found


def ended(supervisor: Supervisor, instance: str) -> int:
    deadline_s = time.monotonic() + TIMEOUT_S
    while (process := supervisor.processes()[instance]).state != "EXITED":
        assert time.monotonic() < deadline_s, process
        time.sleep(0.02)
    return process.exit_status


@pytest.mark.processes
def test_module_runs_in_a_fork_as_if_executed(
    state: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    supervisor = started(state, monkeypatch, {"toy_forked": ""}, "toy_forked", "toy_forked 3")
    facts = facts_of(state, "one-1")
    process = supervisor.processes()["one-1"]
    assert facts["pid"] == process.pid
    assert facts["forked"]
    assert facts["handler"]
    assert facts["main"] == "__main__"
    assert facts["instance"] == "one-1"
    command = psutil.Process(process.pid).cmdline()
    assert " ".join(command).split()[:3] == [sys.executable, "-m", "toy_forked"]
    assert facts_of(state, "two-1")["argv"][1:] == ["3"]
    assert ended(supervisor, "two-1") == 3


@pytest.mark.processes
def test_end_of_a_fork_is_that_of_an_interpreter(
    state: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands = ("toy_ends raise", "toy_ends because", "toy_ends 0")
    supervisor = started(state, monkeypatch, {"toy_ends": ""}, *commands)
    assert [ended(supervisor, f"{name}-1") for name in ("one", "two", "three")] == [1, 1, 0]
    assert all(facts_of(state, f"{name}-1")["forked"] for name in ("one", "two", "three"))
    assert "ValueError: no such model" in state.log_of("one-1").read_text()
    assert state.log_of("two-1").read_text() == "because\n"


@pytest.mark.processes
def test_where_an_import_starts_a_thread_all_are_executed(
    state: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    programs = {"toy_plain": "", "toy_threaded": THREADED}
    started(state, monkeypatch, programs, "toy_plain", "toy_threaded")
    assert not facts_of(state, "one-1")["forked"]


@pytest.mark.processes
def test_module_that_cannot_be_imported_says_why_in_its_log(
    state: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    supervisor = started(state, monkeypatch, {}, "toy_absent")
    assert ended(supervisor, "one-1") == 1
    assert "No module named toy_absent" in state.log_of("one-1").read_text()


@pytest.mark.processes
def test_import_of_all_services_starts_no_thread() -> None:
    code = (
        "import sys; from deploy.launcher.prefork import load; "
        "found = load(sys.argv[1:]); assert len(found) == len(sys.argv) - 1, found"
    )
    names = ("router", "camera", "detector", "reid", "tracker", "gait", "gt_bridge", "dashboard")
    more = ("events", "predictor", "ros2_bridge", "report")
    modules = [f"services.{name}" for name in (*names, *more)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", code, *modules, "deploy.launcher.watchdog"]
    subprocess.run(command, check=True, env=environment, timeout=2 * TIMEOUT_S)
