"""Payloads that are longer than their topic allows are dropped before they are read."""

import os
import subprocess
import sys
import time

import psutil
import pytest
import zenoh

from common.transport.ports import free_port
from common.transport.zenoh_bus import read_config
from people4d.topics import OTHER_MAX_BYTES, prefix
from tests.network import WAIT_S, Network

pytestmark = [pytest.mark.processes, pytest.mark.network]

SIZE = 50 * 2**20
COUNT = 4
# One payload: Zenoh holds the fragments of one that was cut off on a slow machine.
GROWTH_MAX_MB = SIZE / 2**20
READER = """
import sys
from common.transport.zenoh_bus import ZenohBus, read_config
from people4d.messages import Embeddings
from people4d.queue import MessageQueue
from people4d.topics import BY_MESSAGE
bus = ZenohBus(read_config(None, "peer"), sys.argv[1])
topic, queue = BY_MESSAGE[Embeddings], MessageQueue()
queue.follow(bus.subscribe(topic), topic)
print("ready", flush=True)
for line in sys.stdin:
    print(queue.counters["bad_embeddings"], queue.last_error, flush=True)
bus.close()
"""


def test_long_payloads_are_counted_and_leave_no_memory(network: Network) -> None:
    robot, endpoint = network.robot(), f"tcp/127.0.0.1:{free_port()}"
    reader = subprocess.Popen(
        [sys.executable, "-c", READER, robot],
        env=os.environ | network.environment | {"PEOPLE4D_LISTEN": endpoint},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert reader.stdout
        assert reader.stdout.readline() == "ready\n"
        before_mb = used_mb(reader.pid)
        assert send_until_counted(endpoint, robot, reader) == (
            f"embeddings: expected at most {OTHER_MAX_BYTES} bytes, got {SIZE}"
        )
        end_s = time.monotonic() + WAIT_S
        while (used := used_mb(reader.pid)) >= before_mb + GROWTH_MAX_MB:
            assert time.monotonic() < end_s, f"{used:.1f} MB after {before_mb:.1f} MB"
            time.sleep(0.1)  # until Zenoh has released the last payload
    finally:
        reader.kill()
        reader.communicate()


def send_until_counted(endpoint: str, robot: str, reader: "subprocess.Popen[str]") -> str:
    """Send payloads past the router, which drops some, until enough are counted."""
    assert reader.stdin
    assert reader.stdout
    end_s = time.monotonic() + 6 * WAIT_S
    with zenoh.open(read_config(None, "client", {"PEOPLE4D_CONNECT": endpoint})) as session:
        block = zenoh.CongestionControl.BLOCK
        publisher = session.declare_publisher(
            f"{prefix(robot)}/embeddings/front", congestion_control=block
        )
        while time.monotonic() < end_s:
            publisher.put(bytes(SIZE))
            reader.stdin.write("\n")
            reader.stdin.flush()
            count, _, error = reader.stdout.readline().partition(" ")
            if int(count) >= COUNT:
                return error.strip()
    raise TimeoutError(f"{count} of {COUNT} payloads were counted")


def used_mb(pid: int) -> float:
    used: float = psutil.Process(pid).memory_full_info().uss / 2**20
    return used
