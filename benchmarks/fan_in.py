"""Cost of a message of tracks for a router and a reader when many robots share one router."""

import argparse
import tempfile
import threading
import time
from pathlib import Path

import msgspec
import numpy as np
import psutil
import zenoh

from benchmarks.lib.system.services import Cluster
from benchmarks.lib.table import markdown, write
from benchmarks.message_sizes import SPAN, STAGES
from common.transport.zenoh_bus import read_config
from people4d.codec import decode, encode
from people4d.messages import Track, Tracks
from people4d.topics import prefix

ROBOTS = (1, 10, 100)
RATE_HZ = 1000.0  # of all robots together; what a busy machine can do too
QUEUE = 10_000
PEOPLE = 3


def people(count: int) -> Tracks:
    """Return a message as three robots and a thousand send it."""
    tracks = tuple(
        Track(
            id=number + 1,
            state="confirmed",
            position_m=np.array([1.0, 2.0, 3.0]),
            velocity_mps=np.zeros(3),
            covariance=np.eye(6),
            yaw_rad=0.5,
            hits=100,
            age=120,
            time_since_update_s=0.0,
            detection=number,
            score=0.9,
            identity="continued",
            identity_confidence=0.9,
        )
        for number in range(count)
    )
    return Tracks(
        stamp_ns=SPAN.start_ns,
        sequence=1,
        trace=(SPAN,) * STAGES["people"],
        frame_id="map",
        tracker="strongsort3d",
        camera="front",
        tracks=tracks,
    )


def codec_us(message: Tracks, rounds: int = 2000) -> tuple[float, float]:
    """Return microseconds of the processor that encoding and decoding take."""
    payload = encode(message)
    starts = [time.process_time()]
    for work in (lambda: encode(message), lambda: decode(payload)):
        for _ in range(rounds):
            work()
        starts.append(time.process_time())
    encoding, decoding = np.diff(starts) / rounds * 1e6
    return float(encoding), float(decoding)


def route_us(robots: int, seconds: float, payload: bytes) -> tuple[int, float]:
    """Send as many robots through a router to one reader.

    Returns:
        Messages that came, and microseconds of the processor that the router took for each.
    """
    keys = [f"{prefix(f'robot-{number}')}/people" for number in range(robots)]
    with tempfile.TemporaryDirectory() as logs:
        cluster = Cluster(Path(logs))
        environment = {"PEOPLE4D_CONNECT": cluster.endpoint}
        router = psutil.Process(cluster.processes["router"].pid)
        arrived, done = [0], threading.Event()

        def take(_: zenoh.Sample) -> None:
            arrived[0] += 1

        try:
            with (
                zenoh.open(read_config(None, "client", environment)) as reader,
                zenoh.open(read_config(None, "client", environment)) as sender,
            ):
                reader.declare_subscriber(f"{prefix('*')}/people", take)
                publishers = [sender.declare_publisher(key) for key in keys]
                while not arrived[0]:
                    publishers[0].put(payload)
                    done.wait(0.1)
                before, begin_s = router.cpu_times(), time.monotonic()
                first = arrived[0]
                for number in range(int(seconds * RATE_HZ)):
                    publishers[number % robots].put(payload)
                    done.wait(max(0.0, begin_s + number / RATE_HZ - time.monotonic()))
                done.wait(1.0)
                after, came = router.cpu_times(), arrived[0] - first
        finally:
            cluster.close()
    used_s = after.user + after.system - before.user - before.system
    return came, used_s / came * 1e6


def main() -> None:
    """Measure and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="3 s of each instead of 20")
    seconds = 3.0 if parser.parse_args().quick else 20.0
    sizes = [len(encode(people(count))) for count in (0, 1, 2)]
    message = people(PEOPLE)
    encoding_us, decoding_us = codec_us(message)
    bare = msgspec.structs.replace(message, trace=())
    bare_us = codec_us(bare)[1]
    payload = encode(message)
    rows = []
    for robots in ROBOTS:
        came, cost_us = route_us(robots, seconds, payload)
        rows.append([f"{robots}", f"{seconds * RATE_HZ:.0f}", f"{came}", f"{cost_us:.0f}"])
    write(
        __file__,
        "Many robots through one router",
        f"People messages of {PEOPLE} people, {len(payload):,} bytes each "
        f"({len(encode(bare)):,} without trace), {RATE_HZ:.0f} a second over TCP on loopback, from "
        "one process under the keys of so many robots. Time is that of the processor, which a busy "
        "machine changes little.",
        markdown(["robots", "sent", "came", "router, us a message"], rows),
        f"Encoding takes {encoding_us:.0f} us, decoding {decoding_us:.0f} us "
        f"({bare_us:.0f} us without trace). A message has {sizes[0]} bytes without people and "
        f"{sizes[2] - sizes[1]} for each.",
    )


if __name__ == "__main__":
    main()
