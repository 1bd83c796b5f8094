"""One RGB-D frame from camera to detector: our bus beside pyzmq, same codec, same run."""

import multiprocessing
import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import zmq

from benchmarks.lib.table import markdown, quantiles, spread, write
from common.transport.ports import free_port
from common.transport.zenoh_bus import ZenohBus, read_config
from people4d.codec import decode, encode
from people4d.messages import RgbdFrame
from people4d.topics import BY_MESSAGE

ROUNDS = 5
FRAMES = 150
RATE_HZ = 30.0

Publish = Callable[[RgbdFrame], None]


def frame(sequence: int) -> RgbdFrame:
    """Return a 640x480 frame of noise, stamped now."""
    rng = np.random.default_rng(sequence)
    rgb = rng.integers(0, 255, (480, 640, 3), np.uint8)
    depth = rng.integers(0, 5000, (480, 640), np.uint16)
    return RgbdFrame(
        stamp_ns=time.time_ns(), sequence=sequence, camera="front", rgb=rgb, depth_mm=depth
    )


def zenoh_config(port: int, listen: bool, shared_memory: bool) -> Any:
    """Return the shipped peer configuration on a port of its own."""
    endpoint = f"tcp/127.0.0.1:{port}"
    name = "PEOPLE4D_LISTEN" if listen else "PEOPLE4D_CONNECT"
    config = read_config(None, "peer", {name: endpoint})
    if listen:
        config.insert_json5("connect/endpoints", "[]")
    config.insert_json5("transport/shared_memory/enabled", str(shared_memory).lower())
    return config


def zenoh_publisher(port: int, shared_memory: bool) -> Publish:
    bus = ZenohBus(zenoh_config(port, True, shared_memory), "bench")
    return bus.publish


def zenoh_payloads(port: int, shared_memory: bool) -> Iterator[bytes]:
    bus = ZenohBus(zenoh_config(port, False, shared_memory), "bench")
    for _, payload in bus.subscribe(BY_MESSAGE[RgbdFrame]):
        yield payload


def zmq_publisher(port: int, _: bool) -> Publish:
    sender: Any = zmq.Context.instance().socket(zmq.PUB)
    sender.setsockopt(zmq.SNDHWM, 2)
    sender.bind(f"tcp://127.0.0.1:{port}")
    return lambda message: sender.send(encode(message), copy=False) and None


def zmq_payloads(port: int, _: bool) -> Iterator[bytes]:
    receiver: Any = zmq.Context.instance().socket(zmq.SUB)
    receiver.setsockopt(zmq.RCVHWM, 2)
    receiver.connect(f"tcp://127.0.0.1:{port}")
    receiver.subscribe(b"")
    while True:
        yield receiver.recv()


TRANSPORTS = {
    "people4d (Zenoh, shared memory)": (zenoh_publisher, zenoh_payloads, True),
    "people4d (Zenoh, TCP)": (zenoh_publisher, zenoh_payloads, False),
    "pyzmq PUB/SUB (TCP)": (zmq_publisher, zmq_payloads, False),
}


def camera(name: str, port: int, go: Connection) -> None:
    """Publish frames at the camera's rate once told to; the process ends with its parent."""
    publisher, _, shared_memory = TRANSPORTS[name]
    publish = publisher(port, shared_memory)
    go.recv()
    frames = [frame(n) for n in range(8)]
    due = time.monotonic()
    for sequence in range(FRAMES):
        due += 1 / RATE_HZ
        time.sleep(max(due - time.monotonic(), 0))
        source = frames[sequence % len(frames)]
        publish(
            RgbdFrame(
                stamp_ns=time.time_ns(),
                sequence=sequence,
                camera="front",
                rgb=source.rgb,
                depth_mm=source.depth_mm,
            )
        )
    go.recv()


def measure(name: str) -> tuple[list[float], int]:
    """Run one round.

    Args:
        name: One of TRANSPORTS.

    Returns:
        Time from before encoding to after decoding of each frame [ms], and the frames lost.
    """
    port = free_port()
    here, there = multiprocessing.Pipe()
    sender = multiprocessing.Process(target=camera, args=(name, port, there), daemon=True)
    sender.start()
    _, payloads, shared_memory = TRANSPORTS[name]
    times_ms: list[float] = []
    last = threading.Event()

    def receive() -> None:
        for payload in payloads(port, shared_memory):
            message = decode(payload)
            times_ms.append((time.time_ns() - message.stamp_ns) / 1e6)
            if message.sequence == FRAMES - 1:
                last.set()
                return

    threading.Thread(target=receive, daemon=True).start()
    time.sleep(1.5)  # both ends must have met: neither transport tells a publisher-only process
    here.send("go")
    last.wait(FRAMES / RATE_HZ + 5)
    here.send("end")
    sender.join(5)
    sender.terminate()
    return times_ms[5:], FRAMES - len(times_ms)


def main() -> None:
    """Measure all transports in turn, several rounds."""
    rounds: dict[str, list[tuple[list[float], int]]] = {name: [] for name in TRANSPORTS}
    for number in range(ROUNDS):
        for name in TRANSPORTS:
            print(f"round {number + 1} of {ROUNDS}: {name}", flush=True)
            rounds[name].append(measure(name))
    rows = []
    for name, results in rounds.items():
        together = [value for times_ms, _ in results for value in times_ms]
        medians = [float(np.median(times_ms)) for times_ms, _ in results]
        lost = sum(lost for _, lost in results)
        rows.append([name, *quantiles(together), spread(medians), str(lost)])
    header = ["transport", "p50 ms", "p95 ms", "p99 ms", "median of rounds (spread)", "lost"]
    write(
        __file__,
        "Transport: one 640x480 RGB-D frame from camera to detector",
        f"From before encoding to after decoding, {ROUNDS} rounds of {FRAMES} frames at "
        f"{RATE_HZ:.0f} Hz between two processes on loopback, transports in turn; 1.5 MB a frame.",
        markdown(header, rows),
    )


if __name__ == "__main__":
    multiprocessing.set_start_method("spawn")
    main()
