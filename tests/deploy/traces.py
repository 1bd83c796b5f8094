"""Messages of a small system: two hosts, a camera, two detectors, a tracker."""

import msgspec

from people4d.messages import Detections, Health, Message, Span, Tracks
from people4d.messages.status import State
from people4d.queue import Arrival
from tests import builders
from tests.contract.examples import BY_NAME

MS = 1_000_000
BEGIN_NS = 1_700_000_000_000 * MS
AHEAD_MS = 250.0  # lead of the clock of host "brain" [ms]


def span(stage: str, start_ms: float, end_ms: float, process: str) -> Span:
    start_ns, end_ns = (BEGIN_NS + round(ms * MS) for ms in (start_ms, end_ms))
    return Span(stage=stage, process=process, start_ns=start_ns, end_ns=end_ns)


def trace_of(number: int, until: str = "tracker") -> tuple[Span, ...]:
    """Return the trace of a frame; frames arrive every 20 ms and take 45 ms."""
    t = 20.0 * number
    detector = f"detector-{1 + number % 2}@nuc"
    b = t + AHEAD_MS  # the same moment on the clock of "brain"
    spans = [
        span("camera.release", t, t + 1, "camera-1@nuc"),
        span("camera.publish", t + 1, t + 2, "camera-1@nuc"),
        span("detector.decode", t + 4, t + 5, detector),
        span("detector.queue", t + 5, t + 6, detector),
        span("detector.inference", t + 6, t + 36, detector),
        span("detector.publish", t + 36, t + 37, detector),
        span("tracker.decode", b + 40, b + 41, "tracker-1@brain"),
        span("tracker.queue", b + 41, b + 42, "tracker-1@brain"),
        span("tracker.association", b + 42, b + 44, "tracker-1@brain"),
        span("tracker.publish", b + 44, b + 45, "tracker-1@brain"),
    ]
    return tuple(spans if until == "tracker" else spans[:6])


def tracks(number: int) -> Tracks:
    message = msgspec.structs.replace(
        BY_NAME["Tracks"], sequence=number, stamp_ns=number, camera="front", trace=trace_of(number)
    )
    assert isinstance(message, Tracks)
    return message


def detections(number: int) -> Detections:
    trace = trace_of(number, "detector")
    message = msgspec.structs.replace(
        BY_NAME["Detections"], sequence=number, stamp_ns=number, camera="front", trace=trace
    )
    assert isinstance(message, Detections)
    return message


def health(
    service: str, host: str, gauges: dict[str, float] | None = None, state: State = "ready"
) -> Health:
    return builders.health(
        service,
        host=host,
        state=state,
        reason="" if state == "ready" else "no frames arrive",
        counters={
            "received_frames": 100,
            "sent_detections": 90,
            "frames": 100,
            "left_frames": 5,
            "dropped_frames": 10,
            "errors": 0,
        },
        gauges={
            "received_frames_hz": 50.0,
            "sent_detections_hz": 45.0,
            "age_frames_ms": 12.0,
            "cpu_percent": 83.0,
            "memory_mb": 128.0,
            **(gauges or {}),
        },
    )


def healths() -> list[Health]:
    reference = {"clock_offset_ms": 0.0, "clock_error_ms": 0.0}
    ahead = {"clock_offset_ms": AHEAD_MS, "clock_error_ms": 0.5}
    worse = {"clock_offset_ms": AHEAD_MS + 1, "clock_error_ms": 3.0}
    return [
        health("detector", "nuc", reference),
        health("tracker", "brain", ahead),
        health("reid", "brain", worse, "degraded"),
    ]


def arrival(message: Message, after_ms: float = 0.0) -> Arrival:
    """Deliver a message to host "nuc"; frames are finished after 45 ms and come every 20 ms."""
    received_ns = BEGIN_NS + round(after_ms * MS)
    return Arrival(message, received_ns, received_ns + MS)
