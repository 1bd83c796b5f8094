"""Neighbouring areas: their people, and conflicts with this area."""

from collections import Counter, deque
from dataclasses import dataclass, field
from statistics import median

import numpy as np

from common.text import named
from people4d.messages import AreaPeople
from services.tracker.areas.config import SiteAreaConfig
from services.tracker.interface import GalleryEntry, IdCounter

CONFLICT_NS = 5_000_000_000  # time for which areas of one name or number are refused [ns]
SILENCE_NS = 3_000_000_000  # maximum time without a message of an active neighbour [ns]
# Difference of a neighbour's clock above which it is reported [ns]. Hand-over works regardless,
# since a message holds times since the last match
CLOCK_TOLERANCE_NS = 1_000_000_000
RUNS_MAX = 8  # maximum number of stored processes of one name
COUNTERS = ("area_conflicts", "area_refused", "area_clock_apart")


@dataclass(slots=True)
class Neighbour:
    """The last message of a neighbouring area."""

    message: AreaPeople
    heard_ns: int  # [ns] monotonic
    runs: deque[int] = field(default_factory=lambda: deque(maxlen=RUNS_MAX))  # former processes
    offsets_ns: deque[int] = field(default_factory=lambda: deque(maxlen=9))  # offsets of its clock


class Neighbours:
    """The last message of each neighbouring area, and the conflicts that make it unusable.

    Args:
        config: This area.
        frame_id: Frame of its tracks.
    """

    def __init__(self, config: SiteAreaConfig, frame_id: str) -> None:
        self._config, self._frame_id = config, frame_id
        self.name = ""  # name of this area
        self._heard: dict[str, Neighbour] = {}  # last message by area
        self._problems: dict[str, tuple[str, int]] = {}  # message and end of a conflict, by area
        self._started_ns: int | None = None
        self.counters = Counter(dict.fromkeys(COUNTERS, 0)) if config.number else Counter[str]()

    def __bool__(self) -> bool:
        return bool(self._heard)

    def start(self, now_ns: int) -> None:
        """Expect messages from now on."""
        if self._started_ns is None:
            self._started_ns = now_ns

    def add_message(
        self, message: AreaPeople, embedder: str, now_ns: int, time_ns: int | None
    ) -> None:
        """Add a message of another process; arguments as in `AreaExchange.receive`."""
        area, before = message.area, self._heard.get(message.area)
        conflict = self._conflict(message, before)
        problem = conflict or self._mismatch(message, embedder)
        if problem:
            self.counters["area_conflicts" if conflict else "area_refused"] += 1
            self._problems[area] = problem, now_ns + CONFLICT_NS
        if area == self.name:
            return
        neighbour = Neighbour(message, now_ns)
        if before:
            neighbour.runs, neighbour.offsets_ns = before.runs, before.offsets_ns
            if before.message.run != message.run:
                neighbour.runs.append(before.message.run)
        if time_ns is not None:
            neighbour.offsets_ns.append(message.stamp_ns - time_ns)
            self.counters["area_clock_apart"] += self._is_apart(neighbour)
        self._heard[area] = neighbour

    def people(self, ids: IdCounter, time_ns: int, now_ns: int) -> dict[int, GalleryEntry]:
        """Return the people of all usable neighbours by identity, each at the last match.

        Args:
            ids: Identities of this tracker; identities that it has not assigned yet are refused.
            time_ns: Time of a frame; times of matches are returned in its clock.
            now_ns: Monotonic time of its arrival.
        """
        found: dict[int, GalleryEntry] = {}
        for area, neighbour in self._heard.items():
            if now_ns < self._problems.get(area, ("", 0))[1]:
                continue
            sent_ns = time_ns - (now_ns - neighbour.heard_ns)
            for person in neighbour.message.people:
                matched_ns = sent_ns - round(person.unmatched_s * 1e9)
                if time_ns - matched_ns > self._config.memory_s * 1e9:
                    continue
                if ids.is_own(person.id) and person.id >= ids.next:
                    self.counters["area_refused"] += 1
                elif person.id not in found or found[person.id].matched_ns < matched_ns:
                    views = list(person.views.astype(np.float64))
                    found[person.id] = GalleryEntry(
                        person.position_m, matched_ns, views, person.matches
                    )
        return found

    def reasons(self, now_ns: int) -> list[str]:
        """Return a status message for each silent, refused or wrongly timed neighbour."""
        found = [text for text, until_ns in self._problems.values() if now_ns < until_ns]
        silent = [
            area
            for area in self._config.neighbours
            if now_ns - self._heard_ns(area, now_ns) > SILENCE_NS
        ]
        if silent:
            areas = named("area", silent)
            found.append(f"no messages arrive from {areas}: people from there get new identities")
        for area, neighbour in self._heard.items():
            if self._is_apart(neighbour) and area not in silent:
                ahead_s = median(neighbour.offsets_ns) / 1e9
                which = "ahead of" if ahead_s > 0 else "behind"
                found.append(f"the clock of area {area} is {abs(ahead_s):.1f} s {which} this one's")
        return found

    def gauges(self) -> dict[str, float]:
        """Return the offsets of the clocks of neighbours [ms] by name."""
        return {
            f"area_offset_{area}_ms": median(neighbour.offsets_ns) / 1e6
            for area, neighbour in self._heard.items()
            if neighbour.offsets_ns
        }

    def _heard_ns(self, area: str, now_ns: int) -> int:
        neighbour = self._heard.get(area)
        if neighbour is not None:
            return neighbour.heard_ns
        return now_ns if self._started_ns is None else self._started_ns

    def _is_apart(self, neighbour: Neighbour) -> bool:
        return bool(neighbour.offsets_ns) and abs(median(neighbour.offsets_ns)) > CLOCK_TOLERANCE_NS

    def _conflict(self, message: AreaPeople, before: Neighbour | None) -> str:
        """Return a conflict of names or numbers of areas; empty if there is none."""
        area, number = message.area, message.number
        if area == self.name:
            return f"another tracker calls itself area {area}"
        if number == self._config.number:
            return f"area {area} has number {number}, as this one: identities are not unique"
        for name, other in self._heard.items():
            if name != area and other.message.number == number:
                both = f"areas {name} and {area}"
                return f"{both} have number {number}: identities are not unique"
        if before and message.run != before.message.run and message.run in before.runs:
            return f"two trackers serve area {area}: their people are refused"
        return ""

    def _mismatch(self, message: AreaPeople, embedder: str) -> str:
        """Return a reason to refuse the people of a message; empty if there is none."""
        area = message.area
        if message.frame_id != self._frame_id:
            return (
                f"positions of area {area} are in {message.frame_id}, not in {self._frame_id}: "
                "its people are refused"
            )
        if embedder and message.embedder and embedder != message.embedder:
            return (
                f"area {area} has embeddings of {message.embedder}, not of {embedder}: its people "
                "are refused"
            )
        identities = [person.id for person in message.people]
        if len(set(identities)) < len(identities):
            return f"area {area} names an identity twice: its people are refused"
        return ""
