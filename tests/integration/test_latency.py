"""Real processes on a live camera: nothing of a frame's latency is unexplained."""

import time
from pathlib import Path
from statistics import mean

import pytest

from benchmarks.live_camera import LiveDemo
from benchmarks.system import running
from common.latency import parts
from common.messages import Tracks
from common.place import Place
from common.trace import STAGES, Tracer

FRAMES = 20
WARM_UP = 5
CAMERA = f"source={LiveDemo.__module__}:{LiveDemo.__name__}"
SERVICES = (
    *(("tracker", ()), ("reid", ()), ("detector", ())),
    ("camera", (CAMERA, "options.rate_hz=4", "options.pictures=4")),
)


def test_the_stages_of_frames_add_up_to_the_time_since_their_acquisition(tmp_path: Path) -> None:
    """Stages that are named against two stamps that they do not enter: camera's and ours.

    What processes do between their stages, `other`, is left out of the sum, so that a stage that
    nobody measures shows.
    """
    tracer = Tracer(Place("here", "here", "here"))
    named_ms, end_to_end_ms, seen = list[float](), list[float](), set[str]()
    with running(SERVICES, tmp_path) as client:
        for arrival in client.arrivals(Tracks, timeout_s=20):
            now_ns = time.time_ns()
            message = arrival.message
            if not message.trace or message.trace[0].stage != "camera.capture":
                continue  # a prediction
            taken = tracer.taken(message, arrival.received_ns, arrival.decoded_ns, now_ns)
            way = parts(taken.trace)
            assert all(part.end_ns >= part.start_ns for part in way), "on one host time goes on"
            assert way[0].start_ns == message.stamp_ns, "latency counts from the acquisition"
            named_ms.append(sum(part.ms for part in way if part.stage != "other"))
            end_to_end_ms.append((now_ns - message.stamp_ns) / 1e6)
            seen |= {part.name for part in way}
            if len(named_ms) == FRAMES:
                break
    assert len(named_ms) == FRAMES
    assert mean(named_ms[WARM_UP:]) == pytest.approx(mean(end_to_end_ms[WARM_UP:]), rel=0.03)
    assert {name.partition(".")[2] for name in seen} <= set(STAGES)
    work = {"detector.inference", "detector.postprocess", "detector.locate", "detector.crops"}
    work |= {"camera.capture", "camera.release", "reid.embedding", "tracker.association"}
    ways = {
        f"{s}.{stage}"
        for s in ("detector", "reid", "tracker")
        for stage in ("transport", "decode", "queue")
    }
    assert work | ways | {"camera.publish", "reid.publish", "tracker.publish"} <= seen
