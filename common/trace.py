"""Times of the stages that a message passes."""

import contextlib
import contextvars
import time
from collections.abc import Iterator

from common.messages import Span

_collected: contextvars.ContextVar["list[Span] | None"] = contextvars.ContextVar(
    "spans", default=None
)
_place: contextvars.ContextVar[tuple[str, str]] = contextvars.ContextVar("place")


@contextlib.contextmanager
def collect(service: str, process: str) -> Iterator[list[Span]]:
    """Gather the spans measured inside the block, oldest first.

    Args:
        service: First part of the stage names.
        process: Instance that does the work, "<instance>@<host>".
    """
    spans: list[Span] = []
    collected, place = _collected.set(spans), _place.set((service, process))
    try:
        yield spans
    finally:
        _collected.reset(collected)
        _place.reset(place)


@contextlib.contextmanager
def span(stage: str) -> Iterator[None]:
    """Measure the block as one stage; outside of `collect` this does nothing.

    Args:
        stage: Name below the service, for example "inference".
    """
    spans = _collected.get()
    if spans is None:
        yield
        return
    service, process = _place.get()
    start_ns = time.time_ns()
    try:
        yield
    finally:
        spans.append(
            Span(
                stage=f"{service}.{stage}",
                process=process,
                start_ns=start_ns,
                end_ns=time.time_ns(),
            )
        )
