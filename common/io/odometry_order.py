"""Order of playback: odometry before the frames that need it."""

from collections import deque
from collections.abc import Iterable, Iterator
from typing import Protocol, TypeVar

from people4d.messages import MovingTransform, Odometry

MAX_WAIT_NS = 500_000_000  # [ns] maximum wait of an item for odometry, by stamps


class Stamped(Protocol):
    """An item with an acquisition time."""

    @property
    def stamp_ns(self) -> int:
        """Acquisition time [ns]."""
        ...


T = TypeVar("T", bound=Stamped)


def odometry_first(items: Iterable[T]) -> Iterator[T]:
    """Yield each item of a recording after the first odometry that is not older.

    Other items keep their order. An item waits for half a second of stamps at most, and not at all
    before the first odometry.
    """
    waiting: deque[T] = deque()
    newest_ns = -(2**63)  # nothing waits before the first odometry
    for item in items:
        if isinstance(item, Odometry | MovingTransform):
            newest_ns = item.stamp_ns
            yield item
        else:
            waiting.append(item)
        now_ns = item.stamp_ns
        late = now_ns >= newest_ns + MAX_WAIT_NS
        while waiting and (late or not newest_ns < waiting[0].stamp_ns <= now_ns):
            yield waiting.popleft()
    yield from waiting
