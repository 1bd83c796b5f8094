"""The launcher at work on tiny processes, with a real supervisord."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import pytest
from typer.testing import CliRunner

from deploy.cli import app
from deploy.compose import read, select
from deploy.doctor import here
from deploy.launcher.health import Heartbeats
from deploy.launcher.launcher import Launcher, LaunchError, stop, tail
from deploy.launcher.state import State
from deploy.launcher.supervisor import Supervisor
from people4d.errors import People4dError

pytestmark = [pytest.mark.processes, pytest.mark.network]

TIMEOUT_S = 10.0

TOY = """
services:
  first:
    command: [python, -c, "import pathlib, time; pathlib.Path('FOLDER/up').touch(); time.sleep(99)"]
    restart: on-failure:3
  second:
    command: [sh, -c, "test -e FOLDER/up && echo first was there; sleep 99 & wait"]
    depends_on: {first: {condition: service_healthy}}
    deploy: {replicas: 2}
"""


@pytest.fixture
def state(tmp_path: Path) -> Iterator[State]:
    state = State(tmp_path / "robot")
    yield state
    stop(state)


def launcher(state: State, text: str) -> Launcher:
    file = state.folder.parent / "compose.yaml"
    file.write_text(text.replace("FOLDER", str(state.folder.parent)))
    reported: list[tuple[str, str]] = []
    services = select(read(file, {}), set())
    return Launcher(state, services, Heartbeats("", "robot"), lambda *what: reported.append(what))


def wait_for(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + TIMEOUT_S
    while not condition():
        assert time.monotonic() < deadline_s, "the awaited event did not come"
        threading.Event().wait(0.02)


def is_gone(process: psutil.Process) -> bool:
    # A zombie has ended; only its parent, possibly this test, has not read its exit status.
    return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE


def test_services_start_in_order_restart_and_stop(state: State) -> None:
    toy = launcher(state, TOY)
    toy.start("robot", "tcp/127.0.0.1:1", TIMEOUT_S)
    processes = toy.processes()
    assert set(processes) == {"first-1", "second-1", "second-2"}
    assert all(process.pid for process in processes.values())
    wait_for(lambda: tail(state.log_of("second-2"), 1) == "first was there")

    assert toy.summary() == "Everything is up"
    with pytest.raises(People4dError, match=r"runs already.*people4d down"):
        launcher(state, TOY).start("robot", "", TIMEOUT_S)

    # RUNNING first: supervisord restarts a process that ends within its first second.
    wait_for(lambda: toy.processes()["first-1"].state == "RUNNING")
    killed = toy.processes()["first-1"].pid
    assert psutil.Process(killed).environ()["PEOPLE4D_INSTANCE"] == "first-1"
    os.kill(killed, signal.SIGKILL)
    wait_for(lambda: toy.processes()["first-1"].pid not in (0, killed))

    # A newly forked process does not carry the mark of this run yet.
    wait_for(lambda: len(state.leftovers()) == 6)  # supervisord, first, twice second and its sleep
    alive = state.leftovers()
    assert stop(state)
    assert all(map(is_gone, alive))
    assert state.read() is None
    assert not stop(state)


def test_leftovers_of_a_killed_supervisord_are_ended(state: State) -> None:
    toy = launcher(state, TOY)
    toy.start("robot", "", TIMEOUT_S)
    run = state.read()
    assert run is not None
    supervisord = psutil.Process(run.pid)
    supervisord.kill()
    wait_for(lambda: state.read() is None)
    wait_for(lambda: len(state.leftovers()) == 5)
    orphans = state.leftovers()
    with pytest.raises(People4dError, match="does not answer"):
        toy.processes()
    again = launcher(state, TOY)
    again.start("robot", "", TIMEOUT_S)  # finds the orphans and ends them first
    assert all(map(is_gone, orphans))


def test_a_service_that_cannot_start_is_named_with_its_log(state: State) -> None:
    text = """
    services:
      good: {command: [sleep, "99"]}
      bad: {command: [sh, -c, "echo no such model; exit 1"], restart: "on-failure:5"}
    """
    with pytest.raises(LaunchError, match="bad-1 ended before it was ready") as caught:
        launcher(state, text).start("robot", "", TIMEOUT_S)
    assert "no such model" in caught.value.tail
    assert str(state.log_of("bad-1")) in caught.value.hint
    assert state.leftovers() == []


def test_a_service_that_is_never_healthy_is_named(state: State) -> None:
    text = """
    services:
      slow: {command: [sleep, "99"], healthcheck: {test: [CMD, people4d, health, slow]}}
    """
    with pytest.raises(LaunchError, match="slow-1 is not ready after 1 s"):
        launcher(state, text).start("robot", "", 1.0)
    assert state.leftovers() == []
    (found,) = here.running(state)  # doctor knows it afterwards
    assert "the last people4d up failed: slow-1 is not ready after 1 s" in found.what


def test_service_with_exit_code_0_is_finished_and_others_start(state: State) -> None:
    text = """
    services:
      once: {command: [sh, -c, "echo done"]}
      after:
        command: [sleep, "99"]
        depends_on: {once: {condition: service_completed_successfully}}
    """
    toy = launcher(state, text)
    toy.start("robot", "", TIMEOUT_S)
    toy.wait_finished("once")
    processes = toy.processes()
    assert processes["once-1"].finished
    assert processes["after-1"].pid
    assert toy.summary() == "Everything but once-1 is up"


def test_a_later_failure_ends_the_wait(state: State) -> None:
    text = """
    services:
      fails: {command: [sh, -c, "read line < FOLDER/pipe; exit 3"]}
      camera: {command: [sleep, "99"]}
    """
    os.mkfifo(state.folder.parent / "pipe")
    toy = launcher(state, text)
    toy.start("robot", "", TIMEOUT_S)
    (state.folder.parent / "pipe").write_text("go\n")
    with pytest.raises(LaunchError, match=r"fails-1 failed: .*3"):
        toy.wait_finished("camera")


PEOPLE4D = (sys.executable, "-m", "deploy.cli")


@contextmanager
def attached(folder: Path, text: str) -> Iterator["subprocess.Popen[str]"]:
    """Run an attached `people4d up` of a compose file; the block begins when everything is up."""
    file, pipe = folder / "compose.yaml", subprocess.PIPE
    file.write_text(text.replace("FOLDER", str(folder)))
    command = [*PEOPLE4D, "up", "--compose", str(file)]
    environment = {**os.environ, "PEOPLE4D_STATE": str(folder)}
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=environment) as process:
        assert process.stdout
        assert any("Everything is up" in line for line in iter(process.stdout.readline, ""))
        yield process


def test_ctrl_c_stops_everything_and_a_second_up_is_refused_meanwhile(tmp_path: Path) -> None:
    state = State(tmp_path / "robot")
    with attached(tmp_path, TOY) as process:
        wait_for(lambda: len(state.leftovers()) == 6)
        environment = {"PEOPLE4D_STATE": str(tmp_path)}
        second = CliRunner().invoke(app, ["up", "--source", "a.b:C"], env=environment)
        assert "people4d runs already for robot" in second.stderr
        process.send_signal(signal.SIGINT)
        assert process.wait(TIMEOUT_S) == 0
    assert state.leftovers() == []
    assert state.read() is None


def test_up_ends_after_down(tmp_path: Path) -> None:
    # It takes a second to stop, so that `up` asks supervisord while that shuts down.
    slow = "trap 'sleep 1; exit 0' TERM; while true; do sleep 0.1; done"
    with attached(tmp_path, f'services: {{slow: {{command: [sh, -c, "{slow}"]}}}}') as process:
        result = CliRunner().invoke(app, ["down"], env={"PEOPLE4D_STATE": str(tmp_path)})
        assert result.stdout == "Stopped.\n"
        assert process.stdout
        rest = process.stdout.read()
        assert process.wait(TIMEOUT_S) == 0
    assert "Stopped by people4d down." in rest


def test_services_run_on_after_up_whose_supervisord_was_killed(tmp_path: Path) -> None:
    state = State(tmp_path / "robot")
    with attached(tmp_path, 'services: {toy: {command: [sleep, "99"]}}') as process:
        run = state.read()
        assert run is not None
        toy = Supervisor(state).processes()["toy-1"].pid
        os.kill(run.pid, signal.SIGKILL)
        _, errors = process.communicate(timeout=3 * TIMEOUT_S)
    assert process.returncode == 1
    assert "supervisord was killed: the services run on" in errors
    assert [left.pid for left in state.leftovers()] == [toy]
    assert stop(state)
    assert state.leftovers() == []


def test_second_start_is_refused_while_the_first_spawns(state: State) -> None:
    state.prepare()
    with state.locked(0.0), pytest.raises(People4dError, match="just being started or stopped"):
        launcher(state, TOY).start("robot", "", TIMEOUT_S)


def test_down_during_the_start_ends_it_with_its_name(state: State) -> None:
    text = """
    services:
      slow: {command: [sleep, "99"], healthcheck: {test: [CMD, people4d, health, slow]}}
    """
    toy, errors = launcher(state, text), list[BaseException]()

    def start() -> None:
        try:
            toy.start("robot", "", 3 * TIMEOUT_S)
        except People4dError as error:
            errors.append(error)

    starting = threading.Thread(target=start)
    starting.start()
    wait_for(lambda: state.folder.exists() and bool(list(state.folder.glob("start.lock"))))
    wait_for(lambda: stop(state))  # waits until supervisord is there
    starting.join(3 * TIMEOUT_S)
    assert ["people4d down stopped it" in str(error) for error in errors] == [True]
    assert state.leftovers() == []


def test_too_few_open_files_are_reported_with_the_remedy(tmp_path: Path) -> None:
    file = tmp_path / "compose.yaml"
    file.write_text('services: {toy: {command: [sleep, "99"]}}')
    environment = {**os.environ, "PEOPLE4D_STATE": str(tmp_path)}
    up = f"ulimit -n 64; {sys.executable} -m deploy.cli up -d --compose {file}"
    done = subprocess.run(
        ["sh", "-c", up], env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode == 0:
        stop(State(tmp_path / "robot"))
        pytest.skip("this user may raise the number of files that may be open")
    assert "at most 64 files may be open here. Allow 1024: ulimit -n 1024." in done.stderr


@pytest.fixture
def full_disk(tmp_path: Path) -> Iterator[Path]:
    """A small file system without room."""
    folder = tmp_path / "full"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)]
    if os.geteuid() or subprocess.run(mount, check=False, capture_output=True).returncode:
        pytest.skip("file systems cannot be mounted here")
    try:
        with suppress(OSError), (folder / "filling").open("wb", buffering=0) as filling:
            while True:
                filling.write(bytes(4096))
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def test_full_disk_before_the_start_is_an_error_with_a_remedy(full_disk: Path) -> None:
    state = State(full_disk / "robot")
    file = full_disk.parent / "compose.yaml"
    file.write_text('services: {toy: {command: [sleep, "99"]}}')
    services = select(read(file, {}), set())
    toy = Launcher(state, services, Heartbeats("", "robot"), lambda *_: None)
    with pytest.raises(People4dError, match=r"cannot be written: No space left .* Make room"):
        toy.start("robot", "", TIMEOUT_S)
    assert state.leftovers() == []
