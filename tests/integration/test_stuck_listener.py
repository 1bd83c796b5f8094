"""A listener that hangs, or whose link is dead, does not hold up the others."""

import queue
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence

import pytest
import zenoh

from common.transport.zenoh_bus import read_config
from people4d.topics import BY_MESSAGE
from tests.contract.examples import FULL
from tests.network import WAIT_S, Network

pytestmark = [pytest.mark.processes, pytest.mark.network]

KEYS = [
    topic.key_of(example, "robot")
    for example in FULL
    if (topic := BY_MESSAGE[type(example)]).delivery == "queue"
]
PAYLOAD = bytes(20_000)
MESSAGES = 600  # 12 MB: the sockets on the way to the listener hold less than half
LISTENER = """
import sys, time, zenoh
from common.transport.zenoh_bus import read_config
config = read_config(None, "client", {"PEOPLE4D_CONNECT": sys.argv[1]})
config.insert_json5("transport/shared_memory/enabled", "false")
with zenoh.open(config) as session:
    heard = session.declare_subscriber("people4d/**")
    heard.recv()
    print("heard", flush=True)
    time.sleep(60)
"""


@pytest.fixture(scope="module")
def network() -> Iterator[Network]:
    """Router that drops unread messages, as shipped."""
    network = Network(patient=False)
    yield network
    network.close()


def open_session(network: Network) -> zenoh.Session:
    config = read_config(None, "client", network.environment)
    config.insert_json5("transport/shared_memory/enabled", "false")  # as between hosts
    return zenoh.open(config)


def test_hung_listener_does_not_delay_the_others(network: Network) -> None:
    """The router must not wait for this listener, since all its messages would wait, too."""
    hanging = subprocess.Popen(
        [sys.executable, "-c", LISTENER, network.endpoint], stdout=subprocess.PIPE, text=True
    )
    assert hanging.stdout
    try:
        with open_session(network) as speaker, open_session(network) as other:
            heard: queue.Queue[bytes] = queue.Queue()
            _subscriber = other.declare_subscriber(
                "people4d/**", lambda s: heard.put(s.payload.to_bytes())
            )
            publishers = [
                speaker.declare_publisher(
                    key, congestion_control=zenoh.CongestionControl.BLOCK, express=True
                )
                for key in sorted(set(KEYS))
            ]
            until_heard(publishers[0], hanging)
            hanging.send_signal(signal.SIGSTOP)
            assert longest_wait_s(publishers, heard) < 1.0
    finally:
        hanging.kill()
        hanging.wait()
        hanging.stdout.close()


def until_heard(publisher: zenoh.Publisher, listener: "subprocess.Popen[str]") -> None:
    """Publish until a listener reports a message."""
    assert listener.stdout
    end_s = time.monotonic() + WAIT_S
    while time.monotonic() < end_s:
        publisher.put(b"once")
        if (line := read_soon(listener)) == "heard\n":
            return
        assert line == ""
    raise TimeoutError("the listener hears nothing")


def read_soon(listener: "subprocess.Popen[str]") -> str:
    """Return a line if one arrives within a tenth of a second."""
    assert listener.stdout
    ready, _, _ = select.select([listener.stdout], [], [], 0.1)
    return listener.stdout.readline() if ready else ""


def longest_wait_s(publishers: Sequence[zenoh.Publisher], heard: "queue.Queue[bytes]") -> float:
    """Publish by turns, each message once the last is heard; return the longest wait [s]."""
    longest_s = 0.0
    for number in range(MESSAGES):
        payload = PAYLOAD + number.to_bytes(2, "big")
        begin_s = time.monotonic()
        publishers[number % len(publishers)].put(payload)
        while heard.get(timeout=WAIT_S) != payload:
            pass  # earlier output
        longest_s = max(longest_s, time.monotonic() - begin_s)
    return longest_s
