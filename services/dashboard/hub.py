"""Viewers of the page, and what waits to be sent to each.

All of it runs in the thread of the web server; only `publish` and `note` may be called from others.
"""

import asyncio
import contextlib
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import msgspec

from services.dashboard.history import History, Packet

POSITIONS_MAX = 600
QUEUE_MAX = 256  # packets of which none replaces another
FRAME = ("scene", "image", "cloud")  # parts of the packet of a frame
IMAGES = ("image", "cloud")  # kinds of parts that hold pixels
RECORDED = ("scene", "skeletons", "predictions")  # kinds that can be gone back to


class TooSlowError(Exception):
    """A viewer does not take what it is sent."""


@dataclass(eq=False)
class Viewer:
    """One open page."""

    role: str  # operator, or planner: without images
    images: bool = True  # the page shows images
    cloud: bool = False  # the page shows the depth cloud
    paused: bool = False  # the page shows the past
    _newest: dict[str, Packet] = field(default_factory=dict)
    _queue: deque[Packet] = field(default_factory=deque)
    _ready: asyncio.Event = field(default_factory=asyncio.Event)

    def wants(self, kind: str) -> bool:
        """Check that a kind of part is for this viewer."""
        if kind in IMAGES:
            return self.role == "operator" and (self.images if kind == "image" else self.cloud)
        return True

    def put(self, packet: Packet) -> None:
        """Add a packet; one of the same key that still waits is replaced."""
        if packet.key:
            self._newest[packet.key] = packet
        else:
            self._queue.append(packet)
        self._ready.set()

    async def take(self) -> Packet:
        """Wait for a packet.

        Raises:
            TooSlowError: More wait than a page that reads would leave.
        """
        await self._ready.wait()
        if len(self._queue) > QUEUE_MAX:
            raise TooSlowError
        if self._queue:
            packet = self._queue.popleft()
        else:
            packet = self._newest.pop(next(iter(self._newest)))
        if not self._queue and not self._newest:
            self._ready.clear()
        return packet


class Demand(msgspec.Struct, frozen=True):
    """Data that the open pages show."""

    viewers: int = 0
    images: bool = False
    cloud: bool = False


class Hub:
    """Distributes packets to viewers.

    Args:
        history: Holds what can be gone back to.
        on_demand: Called when the demand of the viewers changes.
    """

    def __init__(self, history: History, on_demand: Callable[[Demand], None]) -> None:
        self.history = history
        self.counters: Counter[str] = Counter(
            dict.fromkeys(("viewers_served", "viewers_stuck", "viewers_refused", "bad_requests"), 0)
        )
        self.about: dict[str, Any] = {"type": "about"}  # the system, for pages that open
        # positions of people, for their trajectories on a map that opens later
        self.positions: deque[dict[str, Any]] = deque(maxlen=POSITIONS_MAX)
        self._on_demand = on_demand
        self._demand = Demand()
        self._viewers: set[Viewer] = set()
        self._latest: dict[str, Packet] = {}  # for pages that open later, by key
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def viewers(self) -> int:
        """Number of open pages."""
        return len(self._viewers)

    def attach(self, loop: asyncio.AbstractEventLoop | None) -> None:
        """Take the event loop in which viewers are served; None when that ends."""
        self._loop = loop

    def publish(self, packet: Packet, stays: bool = False) -> None:
        """Send a packet to all viewers; from any thread.

        Args:
            packet: The packet.
            stays: Pages that open later get the last one of its key at once.
        """
        loop = self._loop
        if loop:
            with contextlib.suppress(RuntimeError):  # the server has just ended
                loop.call_soon_threadsafe(self._distribute, packet, stays)

    def join(self, viewer: Viewer) -> None:
        """Add a viewer, which first gets what stays."""
        self.counters["viewers_served"] += 1
        viewer.put(_packet("about", self.about | {"role": viewer.role}))
        trajectories = {"type": "trajectories", "positions": list(self.positions)}
        viewer.put(_packet("trajectories", trajectories))
        for packet in self._latest.values():
            viewer.put(packet)
        self._viewers.add(viewer)
        self.update()

    def leave(self, viewer: Viewer) -> None:
        """Remove a viewer."""
        self._viewers.discard(viewer)
        self.update()

    def update(self) -> None:
        """Report the demand if it has changed."""
        live = [viewer for viewer in self._viewers if not viewer.paused]
        demand = Demand(
            len(self._viewers),
            any(viewer.wants("image") for viewer in self._viewers),
            any(viewer.wants("cloud") for viewer in live),
        )
        if demand != self._demand:
            self._demand = demand
            self._on_demand(demand)

    def seek(self, viewer: Viewer, at_ms: float) -> None:
        """Send a paused viewer what was shown at a time."""
        for packet in self.history.at(at_ms, {kind for kind in FRAME if viewer.wants(kind)}):
            viewer.put(packet)

    def _distribute(self, packet: Packet, stays: bool) -> None:
        recorded = any(kind in RECORDED for kind, _ in packet.parts)
        if recorded:
            self.history.add(packet)
        if stays:
            self._latest[packet.key] = packet
        for viewer in self._viewers:
            if not viewer.paused or not recorded:
                viewer.put(packet)


def _packet(key: str, content: dict[str, Any]) -> Packet:
    return Packet(0.0, key, ((key, msgspec.msgpack.encode(content)),))
