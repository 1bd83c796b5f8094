"""Shared memory of a process that died, which receivers hold until they end."""

import os
import subprocess
import sys

import psutil
import pytest

from common.transport.ports import free_port

pytestmark = [pytest.mark.processes, pytest.mark.network]

READER = """
import zenoh
from common.transport.zenoh_bus import read_config
with zenoh.open(read_config(None, "peer")) as session:
    subscriber = session.declare_subscriber("people4d/v1/robot/embeddings/front")
    print("ready", flush=True)
    for sample in subscriber:
        print(len(sample.payload), flush=True)
"""
SENDER = """
import sys, time, zenoh
from common.transport.zenoh_bus import read_config
with zenoh.open(read_config(None, "peer")) as session:
    publisher = session.declare_publisher(
        "people4d/v1/robot/embeddings/front", congestion_control=zenoh.CongestionControl.BLOCK
    )
    while not publisher.matching_status.matching:
        time.sleep(0.01)
    for _ in range(50):
        publisher.put(bytes(int(sys.argv[1])))
        time.sleep(0.02)  # Zenoh opens its shared memory after the first ones
    sys.stdin.read()
"""
EMBEDDINGS_BYTES = 20 * 512 * 4  # of twenty people
SENDERS = 3


def test_small_messages_of_processes_that_died_leave_no_memory() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with started(READER, PEOPLE4D_LISTEN=endpoint) as reader:
        assert reader.stdout
        assert reader.stdout.readline() == "ready\n"
        for _ in range(SENDERS):
            with started(SENDER, str(EMBEDDINGS_BYTES), PEOPLE4D_CONNECT=endpoint) as sender:
                for _ in range(50):
                    assert reader.stdout.readline() == f"{EMBEDDINGS_BYTES}\n"
                sender.kill()
        maps = psutil.Process(reader.pid).memory_maps(grouped=False)
        shared_mb = sum(m.rss for m in maps if m.path.endswith(".zenoh")) / 2**20
        reader.kill()
    assert shared_mb < 1.0


def started(code: str, *arguments: str, **environment: str) -> "subprocess.Popen[str]":
    """Start a process of Python."""
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        env=os.environ | environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
