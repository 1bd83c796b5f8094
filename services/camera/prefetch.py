"""A thread that reads ahead, so decoding does not delay the node."""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from services.camera.source import SourceFrame, SourceItem

MAX_ITEMS = 1024  # maximum number of waiting items, including odometry between frames
RETRY_S = 1.0  # [s] wait after a failure of a live device


@dataclass(frozen=True)
class PrefetchedItem:
    """An item with the times of its reading."""

    item: SourceItem  # frame or motion
    start_ns: int  # wall clock at the start of reading
    end_ns: int  # wall clock at the end of reading


class Prefetch:
    """Reads items into a bounded queue that holds at most `frames` frames.

    If live, the newest frame replaces a waiting one, and a failed device is retried; otherwise
    reading waits for room, and an error ends it. `play` is called in the thread.
    """

    def __init__(self, play: Callable[[], Iterator[SourceItem]], frames: int, live: bool) -> None:
        self._play = play
        self._room = frames
        self._live = live
        self._items: deque[PrefetchedItem] = deque()
        self._frames = 0
        self._changed = threading.Condition()
        self._stopped = threading.Event()
        self._wake: Callable[[], None] = lambda: None
        self._thread = threading.Thread(target=self._run, name="camera-prefetch", daemon=True)
        self.ended = False  # True after the last item
        self.errors = 0  # number of failures of reading
        self.reason = ""  # reason of the last failure, empty while a live device delivers
        self.skipped = 0  # number of frames replaced by newer ones

    @property
    def stopped(self) -> bool:
        """True once reading must end."""
        return self._stopped.is_set()

    def start(self, wake: Callable[[], None]) -> None:
        """Begin to read; `wake` is called from the thread after each change."""
        self._wake = wake
        self._thread.start()

    def peek(self) -> SourceItem | None:
        """Return the oldest item without taking it, None if nothing waits."""
        with self._changed:
            return self._items[0].item if self._items else None

    def next_item(self) -> PrefetchedItem:
        """Take the oldest item."""
        with self._changed:
            reading = self._items.popleft()
            self._frames -= isinstance(reading.item, SourceFrame)
            self._changed.notify_all()
            return reading

    def stop(self, timeout_s: float) -> None:
        """End reading and wait for the thread, at most for a time: a device may hang."""
        self._stopped.set()
        with self._changed:
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join(timeout_s)

    def _run(self) -> None:
        while not self._stopped.is_set():
            try:
                self._read()
                break
            except Exception as error:  # a camera's SDK or a foreign file may raise anything
                self.errors += 1
                self.reason = str(error) or type(error).__name__
            if not self._live:
                break
            self._wake()
            self._stopped.wait(RETRY_S)
        self.ended = True
        self._wake()

    def _read(self) -> None:
        items = self._play()
        while not self._stopped.is_set():
            start_ns = time.time_ns()
            item = next(items, None)
            if item is None:
                return
            self._put(PrefetchedItem(item, start_ns, time.time_ns()))

    def _put(self, reading: PrefetchedItem) -> None:
        frame = isinstance(reading.item, SourceFrame)
        with self._changed:
            if self._live:
                self._make_room(frame)
            else:
                self._changed.wait_for(
                    lambda: (
                        self._stopped.is_set()
                        or (self._frames < self._room and len(self._items) < MAX_ITEMS)
                    )
                )
            self._items.append(reading)
            self._frames += frame
        if self._live:
            self.reason = ""
        self._wake()

    def _make_room(self, frame: bool) -> None:
        """Drop waiting frames for a newer one, and the oldest of too many items."""
        if frame and self._frames:
            motion = [one for one in self._items if not isinstance(one.item, SourceFrame)]
            self.skipped += self._frames
            self._items, self._frames = deque(motion), 0
        if len(self._items) >= MAX_ITEMS:
            self._items.popleft()
