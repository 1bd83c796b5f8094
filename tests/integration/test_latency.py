"""Real processes on a live camera: nothing of a frame's latency is unexplained."""

import json
import time
from statistics import mean

import pytest

from benchmarks.lib.live_camera import LiveDemo
from benchmarks.lib.system import running
from common.runtime.latency import segments
from common.transport.trace import STAGES, ProcessId, Tracer
from deploy.chrome_trace import KINDS, FrameTraces
from deploy.monitor import of_frame
from people4d.messages import Detections, Tracks
from people4d.queue import Arrival
from tests.deploy.test_trace_file import check, names

FRAMES = 20
WARM_UP = 5
CAMERA = f"source={LiveDemo.__module__}:{LiveDemo.__name__}"
SERVICES = (
    *(("tracker", ()), ("reid", ()), ("detector", ())),
    ("camera", (CAMERA, "options.rate_hz=4", "options.pictures=4")),
)


@pytest.fixture(scope="module")
def arrivals(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Arrival, int]]:
    """What came of a run, each with the wall clock when it was taken [ns]."""
    came, frames = list[tuple[Arrival, int]](), 0
    with running(SERVICES, tmp_path_factory.mktemp("logs")) as client:
        for arrival in client.arrivals(*KINDS, timeout_s=20):
            came.append((arrival, time.time_ns()))
            frames += isinstance(arrival.message, Tracks) and of_frame(arrival.message.trace)
            if frames == FRAMES:
                break
    assert frames == FRAMES
    return came


def test_the_stages_of_frames_add_up_to_the_time_since_their_acquisition(
    arrivals: list[tuple[Arrival, int]],
) -> None:
    """Stages that are named against two stamps that they do not enter: camera's and ours.

    What processes do between their stages, `other`, is left out of the sum, so that a stage that
    nobody measures shows.
    """
    tracer = Tracer(ProcessId("here", "here", "here"))
    named_ms, end_to_end_ms, seen = list[float](), list[float](), set[str]()
    for arrival, now_ns in arrivals:
        message = arrival.message
        if not isinstance(message, Tracks) or not of_frame(message.trace):
            continue
        taken = tracer.taken(message, arrival.received_ns, arrival.decoded_ns, now_ns)
        way = segments(taken.trace)
        assert all(part.end_ns >= part.start_ns for part in way), "on one host time goes on"
        assert way[0].start_ns == message.stamp_ns, "latency counts from the acquisition"
        named_ms.append(sum(part.ms for part in way if part.stage != "other"))
        end_to_end_ms.append((now_ns - message.stamp_ns) / 1e6)
        seen |= {part.name for part in way}
    assert mean(named_ms[WARM_UP:]) == pytest.approx(mean(end_to_end_ms[WARM_UP:]), rel=0.03)
    assert {name.partition(".")[2] for name in seen} <= set(STAGES)
    work = {"detector.inference", "detector.postprocess", "detector.hand_over", "detector.crops"}
    work |= {"camera.capture", "camera.release", "reid.embedding", "tracker.association"}
    ways = {
        f"{service}.{stage}"
        for service in ("detector", "reid", "tracker")
        for stage in ("transport", "decode", "queue", "publish")
    }
    assert work | ways | {"camera.publish"} <= seen


def test_perfetto_can_read_the_frames_of_real_processes(
    arrivals: list[tuple[Arrival, int]],
) -> None:
    traces = FrameTraces()
    for arrival, _ in arrivals:
        traces.add(arrival.message)
    found = json.loads(json.dumps(traces.chrome()))["traceEvents"]
    check(found)
    assert {name.partition("@")[0] for name in names(found).values()} == {
        *("camera-1", "detector-1", "reid-1", "tracker-1")
    }
    assert "clock +0.00 ± 0.00 ms" in {
        event["args"]["labels"] for event in found if event["name"] == "process_labels"
    }
    arrows = sum(event["ph"] == "s" for event in found)
    # Of nearly every frame to the detector, from there to reid, from there to the tracker.
    assert 2 * FRAMES < arrows <= 3 * len(traces.traces)


def test_placing_people_is_beside_the_way(arrivals: list[tuple[Arrival, int]]) -> None:
    """Their pictures go to re-identification before: what is told of it comes with Detections."""
    for arrival, _ in arrivals:
        if isinstance(arrival.message, Detections):
            stages = [span.stage for span in arrival.message.trace]
            assert stages[-4:] == [
                f"detector.{s}" for s in ("crops", "publish", "locate", "publish")
            ]
