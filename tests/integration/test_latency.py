"""Latency of real processes on a live camera: named stages explain all of it."""

import json
import time
from collections.abc import Sequence
from statistics import mean

import pytest

from common.runtime.latency import segments
from common.runtime.monitor import of_frame
from common.transport.clock import serve_time
from common.transport.trace import STAGES, ProcessId, Tracer
from deploy.chrome_trace import KINDS, FrameTraces
from people4d.client import Client
from people4d.messages import Detections, Tracks
from people4d.queue import Arrival
from tests.deploy.test_trace_file import check, names
from tests.integration.processes import LiveCamera, pipeline
from tests.network import Network

pytestmark = [pytest.mark.processes, pytest.mark.network]

FRAMES = 20
WARM_UP = 5
SERVICES: dict[str, Sequence[str]] = {
    "tracker-1": (),
    "reid-1": (),
    "detector-1": (),
    "camera-1": (f"source={LiveCamera.__module__}:{LiveCamera.__name__}", "options.rate_hz=4"),
}


@pytest.fixture(scope="module")
def arrivals(
    network: Network, tmp_path_factory: pytest.TempPathFactory
) -> list[tuple[Arrival, int]]:
    """Messages of a run, each with the wall clock when it was read [ns]."""
    received, frames, robot = list[tuple[Arrival, int]](), 0, network.robot()
    serve_time(network.open(robot))  # as in the process of a router
    with Client(network.endpoint, robot) as client:
        arriving = client.arrivals(*KINDS, timeout_s=20)
        with pipeline(network, robot, SERVICES, str(tmp_path_factory.mktemp("state"))):
            for arrival in arriving:
                received.append((arrival, time.time_ns()))
                frames += isinstance(arrival.message, Tracks) and of_frame(arrival.message.trace)
                if frames == FRAMES:
                    break
    assert frames == FRAMES
    return received


def test_stages_of_frames_sum_to_the_time_since_acquisition(
    arrivals: list[tuple[Arrival, int]],
) -> None:
    """Named stages sum to the difference of two independent stamps: the camera's and the client's.

    Time between stages, `other`, is left out of the sum, so that a stage without a span shows.
    """
    tracer = Tracer(ProcessId("here", "here", "here"))
    named_ms, end_to_end_ms, stages = list[float](), list[float](), set[str]()
    for arrival, now_ns in arrivals:
        message = arrival.message
        if not isinstance(message, Tracks) or not of_frame(message.trace):
            continue
        taken = tracer.taken(message, arrival.received_ns, arrival.decoded_ns, now_ns)
        path = segments(taken.trace)
        assert all(part.end_ns >= part.start_ns for part in path), "one host has one clock"
        assert path[0].start_ns == message.stamp_ns, "latency counts from the acquisition"
        named_ms.append(sum(part.ms for part in path if part.stage != "other"))
        end_to_end_ms.append((now_ns - message.stamp_ns) / 1e6)
        stages |= {part.name for part in path}
    assert mean(named_ms[WARM_UP:]) == pytest.approx(mean(end_to_end_ms[WARM_UP:]), rel=0.03)
    assert {name.partition(".")[2] for name in stages} <= set(STAGES)
    work = {"detector.inference", "detector.postprocess", "detector.hand_over", "detector.crops"}
    work |= {"camera.capture", "camera.release", "reid.inference", "tracker.association"}
    paths = {
        f"{service}.{stage}"
        for service in ("detector", "reid", "tracker")
        for stage in ("transport", "decode", "queue", "publish")
    }
    assert work | paths | {"camera.publish"} <= stages


def test_trace_file_of_real_processes_is_valid(arrivals: list[tuple[Arrival, int]]) -> None:
    traces = FrameTraces()
    for arrival, _ in arrivals:
        traces.add_message(arrival.message)
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


def test_localisation_runs_beside_reid(arrivals: list[tuple[Arrival, int]]) -> None:
    """Crops go to re-identification first; the span of localisation comes with Detections."""
    for arrival, _ in arrivals:
        if isinstance(arrival.message, Detections):
            stages = [span.stage for span in arrival.message.trace]
            after = [stage.removeprefix("detector.") for stage in stages[-10:]]
            of_networks = ["locate", "inference_wait", "inference"] * 2  # body, orientation
            assert after == ["crops", "publish", *of_networks, "locate", "publish"]
