"""Time that the bridge to ROS 2 adds to people, and to planners that do not use it.

A process publishes Tracks at 30 Hz. One subscriber reads them as a planner of ours does, another
reads people_msgs/People on the key of rmw_zenoh, each in a process of its own and by turns with the
bridge off and on.
"""

import argparse
import multiprocessing
import tempfile
import time
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from benchmarks.lib.system.services import Listener, cluster
from benchmarks.lib.table import markdown, quantiles, spread, write
from common.ros2 import types
from common.ros2.config import Ros2Config
from common.ros2.messages.people import PEOPLE
from common.ros2.rmw_zenoh import RmwZenoh
from common.ros2.transport import Ros2Sample
from common.transport.zenoh_bus import ZenohBus, read_config
from people4d.messages import Track, Tracks

RATE_HZ = 30.0
WARM_UP = 30
LIMIT_MS = 1.0  # wanted at p50
PEOPLE_COUNTS = (1, 5, 20)
READERS = ("planner, bridge off", "planner, bridge on", "node of ROS 2")
OUTPUTS = '["people", "markers"]'


def publish(endpoint: str, people: int, messages: int) -> None:
    """Publish tracks stamped now."""
    bus = ZenohBus(read_config(None, "peer", {"PEOPLE4D_CONNECT": endpoint}), "robot")
    tracks = tuple(
        Track(
            id=number + 1,
            state="confirmed",
            position_m=np.array([number, 1.0, 1.2]),
            velocity_mps=np.array([1.0, 0.2, 0.0]),
            covariance=0.01 * np.eye(6),
            yaw_rad=0.3,
            hits=10,
            age=10,
            time_since_update_s=0.0,
            detection=number,
            score=0.9,
        )
        for number in range(people)
    )
    time.sleep(1.0)  # peers find each other
    begin_s = time.monotonic()
    for sequence in range(messages):
        time.sleep(max(0.0, begin_s + sequence / RATE_HZ - time.monotonic()))
        bus.publish(
            Tracks(
                stamp_ns=time.time_ns(),
                sequence=sequence,
                frame_id="map",
                tracker="t",
                camera="c",
                tracks=tracks,
            )
        )
    time.sleep(0.5)
    bus.close()


def planner(endpoint: str, messages: int, pipe: Connection) -> None:
    """Send back the ages of Tracks when they are decoded [ms]."""
    ages_ms: list[float] = []
    with Listener(endpoint) as client:
        for message in client.messages(Tracks, timeout_s=30):
            ages_ms.append((time.time_ns() - message.stamp_ns) / 1e6)
            if message.sequence >= messages - 1:
                break
    pipe.send(ages_ms[WARM_UP:])


def ros_node(endpoint: str, messages: int, pipe: Connection) -> None:
    """Send back the ages of people_msgs/People when they are decoded [ms]."""
    ages_ms: list[float] = []

    def take(sample: Ros2Sample) -> None:
        stamp = types.decode(PEOPLE, sample.cdr).header.stamp
        ages_ms.append((time.time_ns() - stamp.sec * 10**9 - stamp.nanosec) / 1e6)

    types.encode(PEOPLE, {})
    transport = RmwZenoh(Ros2Config(endpoints=(endpoint,)))
    transport.subscribe("/people", PEOPLE, take)
    end_s = time.monotonic() + messages / RATE_HZ + 20
    while len(ages_ms) < messages - 1 and time.monotonic() < end_s:
        time.sleep(0.1)
    transport.close()
    pipe.send(ages_ms[WARM_UP:])


def run(people: int, messages: int, bridged: bool) -> tuple[list[float], list[float]]:
    """Return the ages at the planner, and at the node of ROS if there is a bridge [ms]."""
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as logs, cluster(Path(logs)) as processes:
        endpoint = processes.endpoint
        readers = [planner, ros_node] if bridged else [planner]
        pipes = []
        with Listener(endpoint) as client:
            if bridged:
                processes.start("ros2_bridge", "ros2_bridge-1", [f"publish={OUTPUTS}"])
                processes.wait_ready(client, {"ros2_bridge-1"})
        for reader in readers:
            pipe, theirs = context.Pipe()
            context.Process(target=reader, args=(endpoint, messages, theirs), daemon=True).start()
            pipes.append(pipe)
        time.sleep(4.0)  # until they have subscribed
        publisher = context.Process(target=publish, args=(endpoint, people, messages), daemon=True)
        publisher.start()
        publisher.join()
        ages = [pipe.recv() for pipe in pipes]
    return ages[0], ages[1] if bridged else []


def main() -> None:
    """Measure by turns with the bridge off and on."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--messages", type=int, default=300, help="of each run")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    rows, sums = [], []
    for people in PEOPLE_COUNTS:
        ages: dict[str, list[float]] = {name: [] for name in READERS}
        added = []
        for _ in range(options.rounds):
            off, _none = run(people, options.messages, bridged=False)
            direct, bridged = run(people, options.messages, bridged=True)
            for name, values in zip(READERS, (off, direct, bridged), strict=True):
                ages[name] += values
            added.append(float(np.median(bridged) - np.median(direct)))
        rows += [[str(people), name, *quantiles(ages[name])] for name in READERS]
        sums.append([str(people), spread(added)])
    write(
        __file__,
        "Bridge to ROS 2: time that it adds",
        "Age of people when they are decoded, from the stamp that the publisher of Tracks sets, at "
        f"{RATE_HZ:.0f} Hz on loopback, {options.rounds} rounds of {options.messages} messages. "
        "The planner reads Tracks; the node of ROS 2 reads people_msgs/People on the key of "
        "rmw_zenoh. The bridge publishes people and markers.",
        markdown(["people", "reader", "p50 ms", "p95 ms", "p99 ms"], rows),
        f"Added by the bridge at p50, wanted at most {LIMIT_MS:.0f} ms:",
        markdown(["people", "ms, median of rounds (spread)"], sums),
        "Off, no process of it runs and no other process does anything for it.",
    )


if __name__ == "__main__":
    main()
