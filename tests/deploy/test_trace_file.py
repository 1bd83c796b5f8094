"""people4d trace: its file as Perfetto reads it, by hand and of recordings."""

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import msgspec
import pytest
from typer.testing import CliRunner

from common.io.recording import RecordingWriter
from deploy.chrome_trace import FrameTraces
from deploy.cli import app
from people4d.messages import Message
from tests.deploy.cli.test_top import talking
from tests.deploy.traces import detections, healths, tracks
from tests.network import Network

pytestmark = pytest.mark.network

__all__ = ["talking"]  # a fixture

Event = dict[str, Any]

# Trace Event Format: fields of every event, and additional fields by phase
COMMON = {"name": str, "ph": str, "pid": int, "tid": int}
PHASES: dict[str, dict[str, Any]] = {
    "M": {"args": dict},
    "X": {"ts": float, "dur": float, "cat": str, "args": dict},
    "i": {"ts": float, "s": str, "cat": str},
    "s": {"ts": float, "id": int, "cat": str},
    "f": {"ts": float, "id": int, "cat": str, "bp": str},
}


def events(*messages: Message) -> list[Event]:
    traces = FrameTraces()
    for message in messages:
        traces.add_message(message)
    found = json.loads(json.dumps(traces.chrome()))["traceEvents"]
    check(found)
    return list(found)


def check(found: list[Event]) -> None:
    """Check the fields, the nesting of slices in a lane, and the ends of arrows."""
    for event in found:
        for field, kind in {**COMMON, **PHASES[event["ph"]]}.items():
            assert isinstance(event[field], kind), (field, event)
    slices = [event for event in found if event["ph"] == "X"]
    for lane in by_lane(slices).values():
        open_until: list[float] = []
        for event in sorted(lane, key=lambda e: (e["ts"], -e["dur"])):
            end = event["ts"] + event["dur"]
            while open_until and open_until[-1] <= event["ts"] + 1e-6:
                open_until.pop()
            assert not open_until or end <= open_until[-1] + 1e-6, event
            open_until.append(end)
    arrows: dict[int, dict[str, Event]] = defaultdict(dict)
    for event in found:
        if event["ph"] in "sf":
            assert event["ph"] not in arrows[event["id"]], "an arrow has one end each"
            arrows[event["id"]][event["ph"]] = event
            assert any(holds(one, event) for one in slices), "an arrow begins and ends in a slice"
    for arrow in arrows.values():
        assert set(arrow) == {"s", "f"}
        assert arrow["s"]["pid"] != arrow["f"]["pid"]


def by_lane(slices: list[Event]) -> dict[tuple[int, int], list[Event]]:
    lanes: dict[tuple[int, int], list[Event]] = defaultdict(list)
    for event in slices:
        lanes[event["pid"], event["tid"]].append(event)
    return lanes


def holds(slice_: Event, event: Event) -> bool:
    same = (slice_["pid"], slice_["tid"]) == (event["pid"], event["tid"])
    return same and slice_["ts"] <= event["ts"] <= slice_["ts"] + slice_["dur"]


def names(found: list[Event]) -> dict[int, str]:
    return {e["pid"]: e["args"]["name"] for e in found if e["name"] == "process_name"}


def test_trace_of_one_frame_matches_hand_worked_times() -> None:
    found = events(*healths(), tracks(0))
    process = names(found)
    assert list(process.values()) == ["camera-1@nuc", "detector-1@nuc", "tracker-1@brain"]
    labels = {
        process[e["pid"]]: e["args"]["labels"] for e in found if e["name"] == "process_labels"
    }
    assert labels["tracker-1@brain"] == "clock +250.00 ± 0.50 ms"
    slices = {
        (process[e["pid"]].partition("@")[0], e["name"]): (e["ts"], e["dur"])
        for e in found
        if e["ph"] == "X"
    }
    # Microseconds from the begin of the frame, on the router's clock.
    assert slices["camera-1", "frame 0"] == (0, 2000)
    assert slices["detector-1", "transport"] == (2000, 2000)
    assert slices["detector-1", "frame 0"] == (4000, 33000)
    assert slices["detector-1", "inference"] == (6000, 30000)
    assert slices["tracker-1", "transport"] == (37000, 3000)
    assert slices["tracker-1", "association"] == (42000, 2000)
    arrows = [(process[e["pid"]].partition("@")[0], e["ts"]) for e in found if e["ph"] in "sf"]
    assert arrows == [
        *(("camera-1", 1000), ("detector-1", 4000)),
        *(("detector-1", 36000), ("tracker-1", 40000)),
    ]


def test_spans_in_several_messages_are_written_once() -> None:
    one = events(*healths(), tracks(3))
    assert events(*healths(), detections(3), tracks(3)) == one


def test_frame_that_never_reached_the_tracker_is_written_in_part() -> None:
    found = events(detections(0))
    assert list(names(found).values()) == ["camera-1@nuc", "detector-1@nuc"]


def test_overlapping_frames_of_a_process_have_separate_lanes() -> None:
    # Detector-1 has the first and third of four frames 20 ms apart, 33 ms each: one lane. Camera
    # and tracker finish a frame before the next one arrives.
    found = events(*healths(), *(tracks(number) for number in range(4)))
    lanes = {e["tid"] for e in found if e["name"] == "frame 2" and e["ph"] == "X"}
    assert lanes == {1}
    # If one process handles frames 0 and 2 at once, there are two lanes.
    twice = [msgspec.structs.replace(tracks(0), sequence=n) for n in (0, 1)]
    tids = {e["tid"] for e in events(*healths(), *twice) if e["name"] == "inference"}
    assert tids == {1, 2}


def test_contradicting_clocks_are_marked() -> None:
    wrong = msgspec.structs.replace(
        healths()[1], gauges={"clock_offset_ms": 260.0, "clock_error_ms": 0.5}
    )
    (mark,) = [e for e in events(healths()[0], wrong, tracks(0)) if e["ph"] == "i"]
    # The tracker received it 3 ms after it was sent; with a clock 10 ms off, 7 ms before.
    assert mark["name"] == "transport -7.000 ms: clocks disagree"
    assert mark["args"]["ms"] == -7.0


def test_clocks_not_compared_are_marked() -> None:
    found = events(tracks(0))
    labels = {e["args"]["labels"] for e in found if e["name"] == "process_labels"}
    assert labels == {"clock not compared"}


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    file = tmp_path / "r.mcap"
    with RecordingWriter(file) as writer:
        for number in range(3):
            for message in (*healths(), detections(number), tracks(number)):
                writer.write(message, number)
    return file


def test_trace_of_a_recording_is_written(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "trace.json"
    result = CliRunner().invoke(app, ["trace", str(recording), "-o", str(out)])
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith("3 frames in ")
    written = json.loads(out.read_text("utf-8"))
    check(written["traceEvents"])
    assert written["otherData"]["frames"] == 3
    clocks = written["otherData"]["clocks_ahead_of_the_router"]
    assert clocks["brain"] == {"offset_ms": 250.0, "error_ms": 0.5}


def test_trace_of_a_running_system_is_written(
    network: Network, talking: str, tmp_path: Path
) -> None:
    out = tmp_path / "trace.json"
    arguments = ["trace", "-o", str(out), "--seconds", "1"]
    arguments += ["--connect", network.endpoint, "--robot", talking]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    check(json.loads(out.read_text("utf-8"))["traceEvents"])


def test_empty_trace_is_reported_with_a_hint(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "r.mcap") as writer:
        writer.write(healths()[0], 0)
    result = CliRunner().invoke(app, ["trace", str(tmp_path / "r.mcap")])
    assert result.exit_code == 1
    assert "Record detections, embeddings and people." in result.stderr
