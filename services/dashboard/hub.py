"""Viewers of the page, programs among them, and the packets waiting for each.

Only `Hub.publish` may be called from outside the web server's thread.
"""

import asyncio
import contextlib
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import msgspec

from services.dashboard.history import History, Packet

POSITIONS_MAX = 600  # maximum number of frames in trajectories
FRAME = ("scene", "image", "cloud")  # parts of the packet of a frame
IMAGES = ("image", "cloud")  # parts with pixels
JSON = "json"  # part for programs
RECORDED = ("scene", "skeletons", "predictions")  # parts in the history


@dataclass(eq=False)
class Viewer:
    """One open page, or one program."""

    role: str  # operator or planner; a planner gets no images
    json: bool = False  # True for a program, which gets people as JSON only
    images: bool = True  # True if the page shows images
    cloud: bool = False  # True if the page shows the depth cloud
    paused: bool = False  # True if the page shows the past
    _waiting: dict[str, Packet] = field(default_factory=dict)  # waiting packets by key
    _ready: asyncio.Event = field(default_factory=asyncio.Event)

    def wants(self, kind: str) -> bool:
        """Check that the viewer shows a kind of part."""
        if self.json or kind == JSON:
            return self.json and kind == JSON
        if kind in IMAGES:
            return self.role == "operator" and (self.images if kind == "image" else self.cloud)
        return True

    def add_packet(self, packet: Packet) -> None:
        """Add a packet, which replaces a waiting one of the same key."""
        self._waiting[packet.key] = packet
        self._ready.set()

    async def next_packet(self) -> Packet:
        """Wait for a packet."""
        await self._ready.wait()
        packet = self._waiting.pop(next(iter(self._waiting)))
        if not self._waiting:
            self._ready.clear()
        return packet


class Demand(msgspec.Struct, frozen=True):
    """Number of open pages, and the data they show."""

    viewers: int = 0
    images: bool = False
    cloud: bool = False
    json: bool = False


class Hub:
    """Distributes packets to viewers.

    Args:
        history: Packets that viewers can go back to.
        on_demand: Called when the demand of the viewers changes.
    """

    serves_json = False  # True: programs may join

    def __init__(self, history: History, on_demand: Callable[[Demand], None]) -> None:
        self.history = history
        self.counters: Counter[str] = Counter(
            dict.fromkeys(("viewers_served", "viewers_stuck", "viewers_refused", "bad_requests"), 0)
        )
        self.about: dict[str, Any] = {"type": "about"}  # description of the system
        # positions of people, for trajectories in later pages
        self.positions: deque[dict[str, Any]] = deque(maxlen=POSITIONS_MAX)
        self._on_demand = on_demand
        self._demand = Demand()
        self._viewers: set[Viewer] = set()
        self._latest: dict[str, Packet] = {}  # last packets for later pages, by key
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def viewers(self) -> int:
        """Number of open pages."""
        return len(self._viewers)

    def attach(self, loop: asyncio.AbstractEventLoop | None) -> None:
        """Set the event loop of the web server; None when it ends."""
        self._loop = loop

    def publish(self, packet: Packet, stays: bool = False) -> None:
        """Send a packet to all viewers, from any thread.

        Args:
            packet: Packet to send.
            stays: Send the last packet of its key to pages that open later.
        """
        loop = self._loop
        if loop:
            with contextlib.suppress(RuntimeError):  # the server has just ended
                loop.call_soon_threadsafe(self._distribute, packet, stays)

    def join(self, viewer: Viewer) -> None:
        """Add a viewer, and send it the stored packets."""
        self.counters["viewers_served"] += 1
        viewer.add_packet(_packet("about", self.about | {"role": viewer.role}))
        trajectories = {"type": "trajectories", "positions": list(self.positions)}
        viewer.add_packet(_packet("trajectories", trajectories))
        for packet in self._latest.values():
            viewer.add_packet(packet)
        self._viewers.add(viewer)
        self.update_demand()

    def leave(self, viewer: Viewer) -> None:
        """Remove a viewer."""
        self._viewers.discard(viewer)
        self.update_demand()

    def update_demand(self) -> None:
        """Report the demand of the viewers if it changed."""
        live = [viewer for viewer in self._viewers if not viewer.paused]
        demand = Demand(
            len(self._viewers),
            any(viewer.wants("image") for viewer in self._viewers),
            any(viewer.wants("cloud") for viewer in live),
            any(viewer.json for viewer in self._viewers),
        )
        if demand != self._demand:
            self._demand = demand
            self._on_demand(demand)

    def seek(self, viewer: Viewer, at_ms: float) -> None:
        """Send a paused viewer the packets of a time."""
        kinds = {kind for kind in FRAME if viewer.wants(kind)}
        for packet in self.history.packets_at(at_ms, kinds):
            viewer.add_packet(packet)

    def _distribute(self, packet: Packet, stays: bool) -> None:
        recorded = any(kind in RECORDED for kind, _ in packet.parts)
        if recorded:
            self.history.add_packet(packet)
        if stays:
            self._latest[packet.key] = packet
        for viewer in self._viewers:
            if not viewer.paused or not recorded:
                viewer.add_packet(packet)


def _packet(key: str, content: dict[str, Any]) -> Packet:
    return Packet(0.0, key, ((key, msgspec.msgpack.encode(content)),))
