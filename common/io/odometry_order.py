"""The order in which recorded messages are played: motion before the frame that needs it."""

from collections import deque
from collections.abc import Iterable, Iterator
from typing import Protocol, TypeVar

from people4d.messages import MovingTransform, Odometry

HELD_NS = 500_000_000  # [ns] odometry that is missing for longer is not waited for


class Stamped(Protocol):
    """Anything with an acquisition time."""

    @property
    def stamp_ns(self) -> int:
        """Acquisition time [ns]."""
        ...


T = TypeVar("T", bound=Stamped)


def odometry_first(items: Iterable[T]) -> Iterator[T]:
    """Yield each item after the first odometry that is not older, for which it need not wait then.

    All else keeps its order. Where odometry is missing, items are held for half a second of stamps
    at most; without any odometry none is held.

    Args:
        items: As they were recorded.
    """
    held: deque[T] = deque()
    newest_ns: int | None = None
    for item in items:
        if isinstance(item, Odometry | MovingTransform):
            newest_ns = item.stamp_ns
            yield item
        else:
            held.append(item)
        while held and not _has_to_wait(held[0].stamp_ns, newest_ns, item.stamp_ns):
            yield held.popleft()
    yield from held


def _has_to_wait(stamp_ns: int, newest_ns: int | None, now_ns: int) -> bool:
    if newest_ns is None:
        return False
    return newest_ns < stamp_ns <= now_ns < newest_ns + HELD_NS
