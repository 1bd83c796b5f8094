"""Cost of the marks of tracing alone; part of benchmarks.latency."""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from common.transport.trace import ProcessId, Tracer, span
from people4d.codec import decode, encode
from people4d.messages import Crops, Detections, Embeddings, Message, RgbdFrame, Span, Tracks


@contextmanager
def tracing(on: bool) -> Iterator[None]:
    """Let processes that start inside trace, or not."""
    os.environ["PEOPLE4D_TRACE"] = "on" if on else "off"
    try:
        yield
    finally:
        del os.environ["PEOPLE4D_TRACE"]


def cost_of_marks(trace: Sequence[Span], frames: int) -> dict[str, float]:
    """Measure what tracing adds to one frame on its whole way, in one thread [us].

    Args:
        trace: Of a frame, up to the subscriber.
        frames: Times that everything is measured.
    """
    trace = [s for s in trace if not s.stage.startswith("subscriber.")]
    process_id = ProcessId("detector", "detector-1", "host")
    on, off = Tracer(process_id), Tracer(process_id, on=False)
    stages = sum(not s.stage.endswith(("decode", "queue", "publish")) for s in trace)
    hops = sum(s.stage.endswith(".publish") for s in trace)
    found = {}
    for name, tracer in (("on", on), ("off", off)):

        def measured(tracer: Tracer = tracer) -> None:
            with tracer.working():
                for _ in range(stages):
                    with span("work"):
                        pass

        found[f"measuring {stages} stages, {name}"] = _median_us(measured, frames)
    # Crops and Embeddings go one way, Detections another; each carries what was passed so far.
    by_service: dict[str, type[Message]] = {
        "camera": RgbdFrame,
        "detector": Crops,
        "reid": Embeddings,
        "tracker": Tracks,
    }
    hop = [(by_service[s.stage.partition(".")[0]], k) for k, s in enumerate(trace, 1) if _sent(s)]
    hop += [(Detections, k) for kind, k in hop if kind is Crops]
    for name, keep in (("on", True), ("off", False)):
        tracer = on if keep else off
        messages = [_empty(kind, tuple(trace[: k - 1]) if keep else ()) for kind, k in hop]

        def carried(tracer: Tracer = tracer, messages: Sequence[Message] = messages) -> None:
            for message in messages:
                payload = encode(message, tracer.publishing(message))
                tracer.worked(tracer.taken(decode(payload), 1, 2, 3), [])

        found[f"carrying them over {hops} hops in {len(hop)} messages, {name}"] = _median_us(
            carried, frames
        )
    return found


def _sent(one: Span) -> bool:
    return one.stage.endswith(".publish")


def _empty(kind: type[Message], trace: tuple[Span, ...]) -> Message:
    """Return a small message of a kind: what it holds besides the trace costs the same."""
    fields: dict[type[Message], dict[str, object]] = {
        RgbdFrame: {
            "rgb": np.zeros((2, 2, 3), np.uint8),
            "depth_mm": np.zeros((2, 2), np.uint16),
        },
        Crops: {},
        Detections: {"frame_id": "f", "model": "m", "width": 2, "height": 2},
        Embeddings: {
            "model": "m",
            "detections": (),
            "vectors": np.zeros((0, 4), np.float32),
        },
        Tracks: {"frame_id": "map", "tracker": "t"},
    }
    make: Callable[..., Message] = kind
    return make(stamp_ns=0, sequence=0, trace=trace, camera="front", **fields[kind])


def _median_us(work: Callable[[], None], times: int) -> float:
    taken = []
    for _ in range(times):
        start_ns = time.perf_counter_ns()
        work()
        taken.append(time.perf_counter_ns() - start_ns)
    return float(np.median(taken)) / 1e3
