"""Times of the stages of processing of a message."""

import contextvars
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TypeVar

import msgspec

from people4d.messages import Message, Span
from people4d.messages.base import MAX_TRACE

M = TypeVar("M", bound=Message)

JOINED = "+"  # separator of the instances of one process

# Stages in the order of a frame, "<service>.<stage>"; stages with * are between two measured ones,
# see common.runtime.latency.
STAGES = {
    "capture": "a live camera's frame: from its acquisition until it is in memory",
    "release": "a frame that is due leaves the read-ahead buffer as a message",
    "transport": "* a message's bytes: from sender to receiver, through Zenoh",
    "decode": "bytes become a message, every field checked",
    "queue": "the message waits until the process is free",
    "wait": "* the message waits inside the process for other data of its frame",
    "preprocess": "the image becomes the network's input",
    "inference_wait": "the network is busy with another frame",
    "inference": "the network runs",
    "wake": "the network's thread has ended, and the waiting thread continues",
    "postprocess": "the network's outputs become detections or embeddings",
    "hand_over": "the network is free, another thread begins with the next frame",
    "crops": "crops of detections are cut out and sent",
    "locate": "detections get positions, yaws and masks from depth",
    "embedding": "crops become appearance vectors without a network",
    "association": "detections are matched with the tracks, and tracks updated",
    "prediction": "tracks are predicted without a frame",
    "predict": "positions in the coming seconds are predicted",
    "joints": "joints of people are estimated",
    "target": "the chosen person is found among the tracks",
    "points": "heads, hands and feet are tracked in depth",
    "motion": "the motion of the base is estimated from images",
    "handle": "all work of a process without stages of its own",
    "publish": "after the work: waiting for other threads and for earlier outputs, and encoding",
    "other": "* unmeasured time between the stages of a process",
}


@dataclass(frozen=True)
class ProcessId:
    """Identity of a process."""

    service: str  # name of the service
    instance: str  # name of the process, unique on a robot
    host: str  # name of the machine

    @property
    def process(self) -> str:
        """Name in traces."""
        return f"{self.instance}@{self.host}"


@dataclass(frozen=True, slots=True)
class _Collection:
    """Spans of one piece of work, and the process that does it."""

    process_id: ProcessId
    spans: list[Span] = field(default_factory=list)


_collection: contextvars.ContextVar[_Collection | None] = contextvars.ContextVar(
    "spans", default=None
)


class _Measurement:
    """Measures a block; a class, since a generator takes twice the time."""

    __slots__ = ("_stage", "_start_ns")

    def __init__(self, stage: str) -> None:
        self._stage = stage

    def __enter__(self) -> None:
        self._start_ns = time.time_ns()

    def __exit__(self, *_: object) -> None:
        record(self._stage, self._start_ns, time.time_ns())


def span(stage: str) -> _Measurement:
    """Measure a block as one stage; outside of `collect` this does nothing.

        with span("inference"):
            outputs = session.run(image)

    Blocks must not be nested, or time would count twice.

    Args:
        stage: One of STAGES, or a stage of your own.
    """
    return _Measurement(stage)


def record(stage: str, start_ns: int, end_ns: int) -> None:
    """Record a stage that was measured elsewhere; without `collect` this does nothing.

    Args:
        stage: One of STAGES, or a stage of your own.
        start_ns: Wall clock at its beginning [ns].
        end_ns: Wall clock at its end [ns].
    """
    collection = _collection.get()
    if collection is not None:
        collection.spans.append(_span(collection.process_id, stage, start_ns, end_ns))


@contextmanager
def collect(process_id: ProcessId) -> Iterator[list[Span]]:
    """Gather the spans measured inside the block, oldest first."""
    collection = _Collection(process_id)
    before = _collection.set(collection)
    try:
        yield collection.spans
    finally:
        _collection.reset(before)


class Tracer:
    """Adds the stages of a process to the traces of messages.

    Args:
        process_id: Identity of the process.
        on: False: traces do not change, and spans cost almost nothing.
    """

    def __init__(self, process_id: ProcessId, on: bool = True) -> None:
        self._process_id = process_id
        self.on = on

    @contextmanager
    def working(self) -> Iterator[list[Span]]:
        """Gather the spans measured inside the block, none if off."""
        if not self.on:
            yield []
            return
        with collect(self._process_id) as spans:
            yield spans

    def taken(self, message: M, received_ns: int, decoded_ns: int, taken_ns: int) -> M:
        """Return a message with the times of its arrival.

        The node copies this trace, even if another message triggers the answer.

        Args:
            message: Received message.
            received_ns: Wall clock at its reception [ns].
            decoded_ns: Wall clock after decoding [ns].
            taken_ns: Wall clock at the beginning of its handling [ns].
        """
        return self._extended(
            message,
            _span(self._process_id, "decode", received_ns, decoded_ns),
            _span(self._process_id, "queue", decoded_ns, taken_ns),
        )

    def worked(self, message: M, spans: list[Span]) -> M:
        """Return an answer with the stages of its work."""
        return self._extended(message, *spans)

    def handled(self, start_ns: int, spans: list[Span]) -> list[Span]:
        """Return the stages of the work; the single stage `handle` if the node measured none."""
        return spans or [_span(self._process_id, "handle", start_ns, time.time_ns())]

    def publishing(self, message: Message) -> Callable[[], Span] | None:
        """Return a function that ends the stage `publish`, None if off.

        Args:
            message: Message to be published; the stage begins with the end of its last one.
        """
        if not self.on:
            return None
        last = message.trace[-1] if message.trace else None
        ours = last is not None and last.process == self._process_id.process
        start_ns = last.end_ns if last and ours else time.time_ns()
        return lambda: _span(self._process_id, "publish", start_ns, time.time_ns())

    def _extended(self, message: M, *spans: Span) -> M:
        if not self.on:
            return message
        trace = (*message.trace, *spans)[: MAX_TRACE - 1]  # leaves one span for publishing
        return msgspec.structs.replace(message, trace=trace)


def _span(process_id: ProcessId, stage: str, start_ns: int, end_ns: int) -> Span:
    return Span(
        stage=f"{process_id.service}.{stage}",
        process=process_id.process,
        start_ns=start_ns,
        end_ns=end_ns,
    )
