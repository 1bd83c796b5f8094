"""Node of the events: tracks, skeletons and edits of zones in, events and zones out."""

import sqlite3
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import ClassVar

from common.geometry.transform_buffer import TransformBuffer
from common.runtime.node import LoopCallbacks, Node, Status
from common.transport.stream_clock import StreamClock
from people4d.errors import ConfigError
from people4d.messages import (
    F64,
    Event,
    Message,
    MovingTransform,
    Odometry,
    Skeletons,
    StaticTransform,
    Tracks,
    Zone,
    ZoneEdit,
    Zones,
)
from services.events.config import EventsConfig
from services.events.delivery import Delivery, Receiver
from services.events.journal import JOURNAL, Journal
from services.events.mqtt import MqttBroker
from services.events.postures import PostureRules
from services.events.rules import EventRules
from services.events.webhook import Webhook
from services.events.zones import read_zones, write_zones

CLOCK_JUMP_NS = 1_000_000_000  # minimum backward step of the stamps in a clock reset [ns]
ZONES = "zones.json"
# Deleted with the identities of the tracker when the system restarts
RUN = "events-run.checkpoint"
PUBLISHED = "published"  # name of the mark of published events
COUNTERS = ("stale", "clock_resets", "journal_errors", "edits", "edits_refused")


class EventsNode(Node):
    """Derives events, and writes each to the journal before its publication.

    Args:
        config: Configuration of the service.
        wall_ns: The wall clock.
    """

    inputs: tuple[type[Message], ...] = (
        *(Tracks, Skeletons, ZoneEdit, StaticTransform, MovingTransform, Odometry),
    )
    required_inputs: ClassVar[tuple[type[Message], ...]] = (Tracks,)

    def __init__(self, config: EventsConfig, wall_ns: Callable[[], int] = time.time_ns) -> None:
        self._config = config
        self._rules = EventRules(config)
        self._postures = PostureRules(config.lies_s)
        self._stream = StreamClock(wall_ns)
        self._transforms = TransformBuffer()
        self._journal = Journal(None, config.journal_max)
        self._deliveries: list[Delivery] = []
        self._zones_file: Path | None = None
        self._revision, self._zones = 0, tuple[Zone, ...]()
        self._pending: list[Message] = []
        self._newest_ns: int | None = None
        self._unmarked = -1  # number of the last returned event without a mark
        self._problem = ""
        self._counters = Counter(dict.fromkeys(COUNTERS, 0))

    def attach(self, loop: LoopCallbacks) -> None:
        """Open journal and zones, and continue from the previous process."""
        folder, config = loop.state_folder, self._config
        if folder:
            self._journal.close()
            self._journal = Journal(folder / JOURNAL, config.journal_max)
        file = Path(config.zones_file) if config.zones_file else folder and folder / ZONES
        self._zones_file = file
        if file:
            self._revision, self._zones = read_zones(file)
        self._rules.change_zones(self._zones)
        self._rules.begin_numbers(self._journal.last_number() + 1)
        earlier = self._journal.after(-1)
        for event in earlier:
            self._rules.apply(event)
        published = self._journal.mark(PUBLISHED)
        self._pending = [event for event in earlier if event.sequence > published]
        if folder and not (folder / RUN).exists():
            self._pending += self._recorded(self._rules.close())
            (folder / RUN).touch()
        self._pending.append(self._zones_message())
        receivers, robot = list(self._receivers(loop.robot)), loop.robot
        if receivers and not folder:
            raise ConfigError(
                "events.webhook and events.mqtt need a state folder, where events wait",
                "Set PEOPLE4D_STATE, or start it with people4d up --events.",
            )
        self._deliveries = [Delivery(r, folder / JOURNAL, robot) for r in receivers if folder]

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Process a message; return the events that follow."""
        if isinstance(message, ZoneEdit):
            return self._edit(message)
        if isinstance(message, Skeletons):
            found = self._postures.update(message)
            return self._recorded(
                [
                    event
                    for kind, number, fields in found
                    for event in self._rules.report(kind, number, message.stamp_ns, **fields)
                ]
            )
        if not isinstance(message, Tracks):
            if isinstance(message, StaticTransform | MovingTransform | Odometry):
                self._transforms.add_transform(message)
            return ()
        if message.predicted:  # stamps of predictions may be ahead of the next frames
            return ()
        events = []
        newest_ns = self._newest_ns
        if newest_ns is None:
            newest_ns = self._rules.newest_ns
        if newest_ns is not None and message.stamp_ns < newest_ns:
            if newest_ns - message.stamp_ns < CLOCK_JUMP_NS:
                self._counters["stale"] += 1
                return ()
            self._counters["clock_resets"] += 1
            events = self._rules.close()
        self._newest_ns = message.stamp_ns
        self._rules.offset_ns = self._stream.wall_ns(message) - message.stamp_ns
        events += self._rules.update(message, self._robot(message))
        return self._recorded(events)

    def tick(self, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Return messages that wait since the start; mark published events."""
        if self._pending:
            pending, self._pending = self._pending, []
            numbers = [event.sequence for event in pending if isinstance(event, Event)]
            self._unmarked = max([self._unmarked, *numbers])
            return pending
        if self._unmarked >= 0:
            number, self._unmarked = self._unmarked, -1
            try:
                self._journal.set_mark(PUBLISHED, number)
            except sqlite3.Error as error:
                self._note(error)
        return ()

    def status(self) -> Status:
        """Return state, reason and counters."""
        counters = {**self._counters, "people_left_out": self._rules.left_out}
        problem = self._problem
        for delivery in self._deliveries:
            counters |= delivery.counters
            problem = problem or delivery.problem
        if problem:
            return Status(state="degraded", reason=problem, counters=counters)
        return Status(counters=counters)

    def close(self) -> None:
        """Close the journal."""
        for delivery in self._deliveries:
            delivery.close()
        self.tick(0)
        self._journal.close()

    def _receivers(self, robot: str) -> Iterator[Receiver]:
        if self._config.webhook:
            yield Webhook(self._config.webhook, robot)
        if self._config.mqtt:
            yield MqttBroker(self._config.mqtt, robot)

    def _recorded(self, events: list[Event]) -> list[Event]:
        """Write events to the journal, and return them."""
        if events:
            try:
                self._journal.append(events)
                self._problem = ""
            except sqlite3.Error as error:
                self._note(error)
            self._unmarked = events[-1].sequence
            for delivery in self._deliveries:
                delivery.wake()
        return events

    def _note(self, error: sqlite3.Error) -> None:
        self._counters["journal_errors"] += 1
        self._problem = f"events cannot be written to the journal ({error})"

    def _edit(self, edit: ZoneEdit) -> list[Message]:
        self._counters["edits"] += 1
        problem = ""
        if edit.base != self._revision:
            problem = "the zones were changed meanwhile: edit them again"
        else:
            try:
                if self._zones_file:
                    write_zones(self._zones_file, self._revision + 1, edit.zones)
                self._revision, self._zones = self._revision + 1, edit.zones
                self._rules.change_zones(self._zones)
            except OSError as error:
                problem = f"the zones cannot be saved: {error.strerror}"
        self._counters["edits_refused"] += bool(problem)
        return [self._zones_message(problem)]

    def _zones_message(self, problem: str = "") -> Zones:
        return Zones(
            stamp_ns=time.time_ns(), sequence=self._revision, zones=self._zones, problem=problem
        )

    def _robot(self, tracks: Tracks) -> F64 | None:
        base = self._transforms.lookup(tracks.frame_id, self._config.base_frame, tracks.stamp_ns)
        return None if base is None else base.matrix[:3, 3]
