"""people4d top: sums and tables, by hand and of a running bus."""

import json
import threading
import time
from collections.abc import Iterator

import msgspec
import pytest
from rich.console import Console
from typer.testing import CliRunner

from common.runtime.monitor import MAX_PROCESSES, Monitor, SystemSnapshot
from common.transport.trace import ProcessId
from deploy.cli import app
from deploy.cli.live.top import drawn
from tests.deploy.traces import BEGIN_NS, MS, arrival, detections, healths, span, tracks
from tests.network import Network

pytestmark = pytest.mark.network

HERE = ProcessId("here", "top-1", "nuc")


def monitor(frames: int = 4, clocks: bool = True) -> Monitor:
    """Heartbeats, then a frame every 20 ms that arrives 50 ms after its start."""
    found = Monitor(HERE, 10.0)
    for health in healths() if clocks else ():
        found.add_arrival(arrival(health), BEGIN_NS, 0.0)
    for number in range(frames):
        done_ms = 20 * number + 50
        now_ns = BEGIN_NS + (done_ms + 2) * MS
        found.add_arrival(arrival(tracks(number), done_ms), now_ns, number * 0.02)
    return found


def stages(snapshot: SystemSnapshot, instance: str) -> dict[str, float]:
    (process,) = [p for p in snapshot.processes if p.instance == instance]
    return {stage.stage: stage.p50_ms for stage in process.stages}


def test_stages_of_all_instances_are_on_one_clock() -> None:
    snapshot = monitor().snapshot(0.1)
    assert stages(snapshot, "camera-1") == {"release": 1, "publish": 1}
    # Frames 0 and 2 went to detector-1, 1 and 3 to detector-2.
    assert stages(snapshot, "detector-2") == stages(snapshot, "detector-1")
    assert stages(snapshot, "detector-1")["transport"] == 2
    # 40 - 37 ms; the 250 ms between the clocks are gone.
    assert stages(snapshot, "tracker-1")["transport"] == pytest.approx(3)
    assert stages(snapshot, "top-1") == {"transport": pytest.approx(5), "decode": 1, "queue": 1}
    assert snapshot.end_to_end is not None
    assert snapshot.end_to_end.p50_ms == pytest.approx(52)
    assert snapshot.end_to_end.count == 4
    (tracker,) = [p for p in snapshot.processes if p.instance == "tracker-1"]
    errors = {stage.stage: stage.error_ms for stage in tracker.stages}
    assert (errors["transport"], errors["association"]) == (0.5, 0)


def test_spans_beside_the_path_are_not_in_it() -> None:
    """The detector located people for 5 ms while its crops were on their way."""
    found = Monitor(HERE, 10.0)
    parallel = span("detector.locate", 37, 42, "detector-1@nuc")
    message = detections(0)
    message = msgspec.structs.replace(message, trace=(*message.trace, parallel))
    assert found.add_arrival(arrival(message), BEGIN_NS, 0.0) is None
    path = found.add_arrival(arrival(tracks(0), 50), BEGIN_NS + 52 * MS, 0.0)
    assert path is not None
    assert [(part.name, part.ms) for part in path.parallel] == [("detector.locate", 5)]
    assert "detector.locate" not in {part.name for part in path.parts}
    (detector,) = [p for p in found.snapshot(0.0).processes if p.instance == "detector-1"]
    assert [s.stage for s in detector.stages if s.parallel] == ["locate"]
    line = next(line for line in text(found.snapshot(0.0)).splitlines() if "locate" in line)
    assert line.split() == ["locate", "5.00", "5.00", "5.00", "1", "parallel"]


def test_clock_of_a_host_is_that_of_its_process_with_the_least_error() -> None:
    clocks = {c.host: (c.offset_ms, c.error_ms) for c in monitor().snapshot(0.1).clocks}
    assert clocks == {"nuc": (0, 0), "brain": (250, 0.5)}


def test_clocks_not_compared_are_marked() -> None:
    snapshot = monitor(clocks=False).snapshot(0.1)
    assert [(c.host, c.offset_ms) for c in snapshot.clocks] == [("brain", None), ("nuc", None)]
    assert stages(snapshot, "tracker-1")["transport"] == 253
    assert "(clocks not compared)" in text(snapshot)


def test_health_is_shown_beside_the_stages() -> None:
    processes = {p.instance: p for p in monitor().snapshot(0.1).processes}
    detector = processes["detector-1"]
    assert detector.rates_hz == {"received_frames": 50, "sent_detections": 45}
    assert detector.ages_ms == {"frames": 12}
    assert detector.losses == {"dropped_frames": 10}  # left_frames are a replica's
    assert (detector.cpu_percent, detector.memory_mb) == (83, 128)
    assert list(processes)[:2] == ["camera-1", "detector-1"]  # processes in processing order
    assert (processes["reid-1"].state, processes["reid-1"].stages) == ("degraded", [])


def test_old_frames_leave_the_window() -> None:
    snapshot = monitor().snapshot(60.0)
    assert snapshot.end_to_end is None
    assert snapshot.processes == []
    assert "no frame passed in the last 10 s" in text(snapshot)


def test_invented_processes_make_room_once_they_are_silent() -> None:
    found = Monitor(HERE, 1.0)
    for number in range(3000):
        health = msgspec.structs.replace(healths()[0], instance=f"x-{number}", host=f"h{number}")
        found.add_arrival(arrival(health), BEGIN_NS, 0.0)
        trace = (span(f"x.s{number}", 0, 1, "x@h"),)
        found.add_arrival(
            arrival(msgspec.structs.replace(tracks(number), trace=trace)), BEGIN_NS, 0.0
        )
    assert len(found.healths(0.0)) == MAX_PROCESSES
    assert len(found.clocks) <= MAX_PROCESSES + 1
    for health in healths():
        found.add_arrival(arrival(health), BEGIN_NS, 5.0)
    found.add_arrival(arrival(tracks(0), 50), BEGIN_NS + 52 * MS, 5.0)
    snapshot = found.snapshot(5.0)
    names = {process.instance for process in snapshot.processes}
    assert {"camera-1", "detector-1", "tracker-1", "reid-1"} <= names
    assert not [name for name in names if name.startswith("x-")]


def text(snapshot: SystemSnapshot) -> str:
    console = Console(width=120)
    with console.capture() as capture:
        console.print(drawn(snapshot))
    return capture.get()


def test_table_shows_all_stages() -> None:
    lines = [line.split() for line in text(monitor().snapshot(0.1)).splitlines()]
    assert lines[0][:5] == ["end", "to", "end", "p50", "52.0"]
    clocks = "clocks ahead of the router's: brain +250.00 ± 0.50 ms · nuc 0 (the router's)"
    assert lines[1] == clocks.split()
    assert ["detector-1", "ready", "83", "128", "frames", "50", "12", "detections", "45"] in [
        line[:9] for line in lines
    ]
    assert ["tracker-1", "transport", "3.00", "3.00", "3.00", "4", "±", "0.50"] in lines
    assert ["inference", "30.00", "30.00", "30.00", "2"] in lines
    assert ["reid-1:", "no", "frames", "arrive"] in lines
    assert ["here", "transport"] in [line[:2] for line in lines]
    assert ["detector-2", "transport"] in [line[:2] for line in lines]  # it sends no heartbeat


@pytest.fixture
def talking(network: Network) -> Iterator[str]:
    """Name of a robot that publishes tracks and health periodically."""
    robot, stop = network.robot(), threading.Event()
    bus = network.open(robot)

    def talk() -> None:
        while not stop.wait(0.02):
            for message in (*healths(), tracks(1)):
                bus.publish(message)

    thread = threading.Thread(target=talk)
    thread.start()
    yield robot
    stop.set()
    thread.join()


def test_once_prints_text_or_json(network: Network, talking: str) -> None:
    arguments = ["top", "--once", "--window", "1"]
    arguments += ["--connect", network.endpoint, "--robot", talking]
    shown, plain = (CliRunner().invoke(app, [*arguments, *more]) for more in ([], ["--json"]))
    assert (shown.exit_code, plain.exit_code) == (0, 0), shown.output + plain.output
    assert "association" in shown.stdout
    snapshot = json.loads(plain.stdout)
    assert {p["instance"] for p in snapshot["processes"]} >= {"tracker-1", "detector-2", "reid-1"}
    assert snapshot["end_to_end"]["count"] > 0


def test_period_of_the_figures_is_at_most_the_time_since_the_start(
    network: Network, talking: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("deploy.cli.live.top.FIRST_S", 0.2)
    arguments = ["top", "--once", "--json", "--connect", network.endpoint, "--robot", talking]
    begin_s = time.monotonic()
    result = CliRunner().invoke(app, arguments)
    assert 0.2 <= json.loads(result.stdout)["seconds"] <= time.monotonic() - begin_s + 0.05


def test_silence_is_reported_with_a_hint(network: Network) -> None:
    arguments = ["top", "--once", "--window", "1", "--connect", network.endpoint]
    result = CliRunner().invoke(app, [*arguments, "--robot", network.robot()])
    assert result.exit_code == 1
    assert "no heartbeat arrived within 2 s. See what runs with people4d ps." in result.stderr
