"""Faults of a running system, with the outcomes of docs/operation/faults.md."""

import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from common.diagnosis.evidence import Diagnostic
from common.transport.ports import free_port
from deploy.cli import app
from deploy.launcher.state import State
from people4d.messages import Detections, Embeddings, Health, Tracks
from tests.integration.system import (
    ROBOT,
    SLOWLY,
    System,
    predicted,
    running,
    seconds,
    shows_people,
    up,
    works_again,
)

pytestmark = [pytest.mark.processes, pytest.mark.network]

# docs/operation/faults.md has the measured times; on a busy machine they may be this much longer.
BACK_S = 10.0
# Warnings of doctor that a busy machine causes: a slow source, stages that wait for each other.
BUSY = {"clocks", "load", "people", "rate", "state"}


def test_up_with_a_missing_model_reports_it_and_leaves_no_process(tmp_path: Path) -> None:
    done = up(tmp_path, free_port(), "--model", "/none.onnx")
    assert done.returncode == 1
    assert "model file /none.onnx does not exist. Check the path." in done.stderr
    assert State(tmp_path / ROBOT).leftovers() == []


def test_up_with_a_taken_port_reports_it(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        done = up(tmp_path, other.getsockname()[1])
    assert done.returncode == 1
    assert "Address already in use" in done.stderr
    assert "Else take another port (people4d up --port" in done.stderr
    assert "error: router-1 ended before it was ready." in done.stderr
    assert State(tmp_path / ROBOT).leftovers() == []


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[System]:
    with running(tmp_path_factory.mktemp("state"), *SLOWLY) as started:
        yield started


@pytest.fixture
def working(system: System) -> System:
    """The system once people are seen."""
    system.watch(Tracks).wait(Tracks, shows_people)
    return system


def doctor(system: System, robot: str) -> tuple[int, dict[str, str]]:
    """Run people4d doctor; return its exit code and what it finds that is not good, by check."""
    command = ["doctor", "--json", "--seconds", "2", "--robot", robot, "--connect", system.connect]
    result = CliRunner().invoke(app, command)
    diagnostics = msgspec.json.decode(result.stdout, type=list[Diagnostic])
    return result.exit_code, {f.check: f.what for f in diagnostics if f.level != "ok"}


def test_doctor_finds_no_fault_in_a_working_system(working: System) -> None:
    status, found = doctor(working, ROBOT)
    assert (status, found.keys() - BUSY) == (0, set())
    status, found = doctor(working, "other")
    assert (status, found["robot"]) == (1, f"no robot is called other; there is {ROBOT}")


def test_killed_detector_is_replaced_while_predictions_continue(working: System) -> None:
    watcher = working.watch(Tracks, Detections, Health)
    killed = working.signal("detector", signal.SIGKILL)
    watcher.wait(Tracks, predicted)
    tracker = working.pid("tracker")
    assert seconds(lambda: watcher.wait(Health, works_again("detector", killed))) < BACK_S
    working.watch(Detections).wait(Detections)
    watcher.wait(Tracks, shows_people)
    assert working.pid("tracker") == tracker


def test_tracks_continue_by_motion_without_reid(working: System) -> None:
    watcher = working.watch(Tracks, Health)
    # A killed process is back too soon to be missed; a stopped one once the watchdog replaces it.
    killed = working.signal("reid", signal.SIGSTOP)
    reason = "no embeddings arrive: tracks are matched by motion alone"
    # On a busy machine the reason may also say that the service is too slow.
    watcher.wait(Health, lambda h: h.service == "tracker" and reason in h.reason)
    watcher.wait(Tracks, lambda m: shows_people(m) and not any("reid" in s.stage for s in m.trace))
    assert seconds(lambda: watcher.wait(Health, works_again("reid", killed))) < BACK_S
    working.watch(Embeddings).wait(Embeddings)
    watcher.wait(Tracks, lambda m: shows_people(m) and any("reid" in s.stage for s in m.trace))


def test_killed_tracker_is_replaced_and_reuses_no_identity(working: System) -> None:
    watcher = working.watch(Tracks, Health)
    before = watcher.wait(Tracks, shows_people)
    killed = working.signal("tracker", signal.SIGKILL)
    assert seconds(lambda: watcher.wait(Health, works_again("tracker", killed))) < BACK_S
    # The same people, or in the next round of the recording people with new numbers.
    newest = max(person.id for person in before.tracks)
    after = working.watch(Tracks).wait(Tracks, shows_people)
    assert all(p.id >= min(q.id for q in before.tracks) for p in after.tracks)
    if after.stamp_ns < before.stamp_ns:
        assert all(p.id > newest for p in after.tracks)


def test_killed_camera_restarts_the_recording(working: System) -> None:
    watcher = working.watch(Tracks, Detections)
    before = watcher.wait(Detections)
    working.signal("camera", signal.SIGKILL)
    watcher.wait(Tracks, predicted)
    again = watcher.wait(Detections, lambda m: m.sequence < before.sequence)
    watcher.wait(Tracks, lambda m: shows_people(m) and m.stamp_ns >= again.stamp_ns)


def test_detector_paused_briefly_is_not_restarted(working: System) -> None:
    stopped = working.signal("detector", signal.SIGSTOP)
    try:
        time.sleep(1.0)  # a fixed time, as waiting for predictions may take too long
    finally:
        working.signal("detector", signal.SIGCONT)
    working.watch(Detections).wait(Detections)
    working.watch(Tracks).wait(Tracks, shows_people)
    assert working.pid("detector") == stopped


def test_hung_detector_is_restarted(working: System) -> None:
    watcher = working.watch(Tracks, Health)
    others = {service: working.pid(service) for service in ("router", "reid", "tracker", "camera")}
    hung = working.signal("detector", signal.SIGSTOP)
    assert seconds(lambda: watcher.wait(Health, works_again("detector", hung))) < BACK_S
    health = watcher.wait(Health, lambda h: h.service == "watchdog" and h.reason != "")
    assert "detector-1 hung (no heartbeat for " in health.reason
    working.watch(Detections).wait(Detections)
    watcher.wait(Tracks, shows_people)
    assert {service: working.pid(service) for service in others} == others


def test_subscriber_receives_again_after_the_router_is_killed(working: System) -> None:
    watcher = working.watch(Tracks, Health)
    before = watcher.wait(Health, lambda h: h.service == "tracker")
    killed = working.signal("router", signal.SIGKILL)
    assert seconds(lambda: watcher.wait(Health, works_again("router", killed))) < BACK_S
    # The services keep exchanging messages: none was restarted, none stalled.
    after = watcher.wait(
        Health, lambda h: h.service == "tracker" and h.stamp_ns > before.stamp_ns + 2 * 10**9
    )
    assert after.pid == before.pid
    assert after.counters["sent_people"] > before.counters["sent_people"]
    working.watch(Tracks).wait(Tracks, shows_people)
