"""Node of the site, which joins the people of all areas to one stream."""

from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from statistics import median
from typing import ClassVar

from common.runtime.node import LoopCallbacks, Node, Status
from common.text import listed
from common.transport.other_robot import topic_of
from people4d.errors import ConfigError
from people4d.messages import Message, Track, Tracks
from people4d.messages.base import MAX_CAMERAS, Name
from services.site.config import SiteConfig
from services.site.merge import merge, predicted

# Maximum silence of a camera whose people are published [s]; trackers predict at 10 Hz
FRESH_S = 0.5
SILENCE_S = 3.0  # maximum silence of an area before it is reported [s]
CLOCK_TOLERANCE_S = 1.0  # maximum difference between the clocks of areas [s]
COUNTERS = ("doubles", "id_conflicts", "other_frame", "refused_cameras", "clock_apart")


class AreaTracks(Message, frozen=True, kw_only=True):
    """Tracks of one area, inside the process."""

    area: Name  # name of the area
    tracks: Tracks  # message of the area's tracker

    @property
    def camera(self) -> str:
        """Camera whose frames number the messages of the area."""
        return self.tracks.camera


@dataclass(slots=True)
class AreaState:
    """Last messages of one area."""

    last: dict[str, tuple[Tracks, int]] = field(default_factory=dict)  # tracks, arrival; by camera
    heard_ns: int | None = None  # monotonic arrival of the last message
    # stamp less arrival of the last messages
    offsets_ns: deque[int] = field(default_factory=lambda: deque(maxlen=15))


class SiteNode(Node):
    """Publishes the people of all areas under the name of the site.

    People are moved by their velocities from the arrival of their message to the time of
    publication. Stamps are in the clock of the first configured area with messages. ConfigError if
    an area is named twice.
    """

    periodic_outputs: ClassVar[tuple[type[Message], ...]] = (Tracks,)

    def __init__(self, config: SiteConfig) -> None:
        if len(set(config.areas)) < len(config.areas):
            raise ConfigError("site.areas: expected each name once, got one twice")
        self._config = config
        self._areas = {area: AreaState() for area in config.areas}
        self.foreign_inputs = [
            topic_of(area, Tracks, partial(_area_tracks, area), AreaTracks) for area in config.areas
        ]
        self._frame_id = ""
        self._now_ns = self._due_ns = 0
        self._started_ns: int | None = None
        self._sequence = 0
        self._counters = Counter(dict.fromkeys(COUNTERS, 0))

    def attach(self, loop: LoopCallbacks) -> None:
        """Check the name of the site; ConfigError if an area has the same name."""
        if loop.robot in self._areas:
            raise ConfigError(
                f"the site has the name of its area {loop.robot}",
                "Give the site a name of its own: --robot.",
            )

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Add the people of an area."""
        self._begin(now_ns)
        if not isinstance(message, AreaTracks):
            return ()
        state, tracks = self._areas[message.area], message.tracks
        self._frame_id = self._frame_id or tracks.frame_id
        if tracks.frame_id != self._frame_id:
            self._counters["other_frame"] += 1
            return ()
        if tracks.camera not in state.last and len(state.last) >= MAX_CAMERAS:
            self._counters["refused_cameras"] += 1
            return ()
        state.last[tracks.camera] = tracks, now_ns
        state.heard_ns = now_ns
        state.offsets_ns.append(tracks.stamp_ns - now_ns)
        self._counters["clock_apart"] += message.area in self._apart_s()
        return ()

    def tick(self, now_ns: int) -> Sequence[Message]:
        """Return the people of all areas when a message is due."""
        self._begin(now_ns)
        if now_ns < self._due_ns:
            return ()
        self._due_ns = now_ns + int(1e9 / self._config.rate_hz)
        heard = [area for area in self._areas.values() if area.heard_ns is not None]
        if not heard:
            return ()
        present = {name: self._people(area, now_ns) for name, area in self._areas.items()}
        merged = merge(present)
        self._counters["doubles"] += merged.doubles
        self._counters["id_conflicts"] += merged.conflicts
        self._sequence += 1
        return [
            Tracks(
                stamp_ns=now_ns + int(median(heard[0].offsets_ns)),
                sequence=self._sequence - 1,
                frame_id=self._frame_id,
                tracker="site",
                camera="site",
                tracks=merged.tracks,
            )
        ]

    def wake_ns(self) -> int | None:
        """Return the monotonic time of the next message."""
        return self._due_ns

    def status(self) -> Status:
        """Report silent areas, and areas with another clock."""
        silence_ns, reasons = SILENCE_S * 1e9, []
        started_ns = self._now_ns if self._started_ns is None else self._started_ns
        if not self._areas:
            reasons.append("no areas are configured: site.areas")
        silent = [
            name
            for name, area in self._areas.items()
            if self._now_ns - (started_ns if area.heard_ns is None else area.heard_ns) > silence_ns
        ]
        if silent:
            reasons.append(f"no people arrive from {listed(silent)}: they are left out")
        for name, ahead_s in self._apart_s().items():
            which = "ahead of" if ahead_s > 0 else "behind"
            reasons.append(f"the clock of area {name} is {abs(ahead_s):.1f} s {which} the first")
        if self._counters["other_frame"]:
            reasons.append(f"people in frames other than {self._frame_id} are left out")
        return Status(
            state="degraded" if reasons else "ready",
            reason="; ".join(reasons),
            counters=dict(self._counters),
        )

    def _begin(self, now_ns: int) -> None:
        self._now_ns = now_ns
        if self._started_ns is None:
            self._started_ns = now_ns

    def _people(self, area: AreaState, now_ns: int) -> list[Track]:
        """Return the present people of an area, each from its newest message."""
        fresh_ns = FRESH_S * 1e9
        newest = dict[int, Track]()
        for tracks, arrived_ns in sorted(area.last.values(), key=lambda one: one[1]):
            age_ns = now_ns - arrived_ns
            if age_ns <= fresh_ns:
                newest |= {track.id: predicted(track, age_ns / 1e9) for track in tracks.tracks}
        return list(newest.values())

    def _apart_s(self) -> Mapping[str, float]:
        """Return the excessive differences of the clocks of areas from the first one [s]."""
        offsets = {
            name: median(area.offsets_ns) / 1e9
            for name, area in self._areas.items()
            if area.offsets_ns
        }
        first = next(iter(offsets.values()), 0.0)
        return {n: s - first for n, s in offsets.items() if abs(s - first) > CLOCK_TOLERANCE_S}


def _area_tracks(area: str, message: Tracks) -> AreaTracks:
    return AreaTracks(
        stamp_ns=message.stamp_ns, sequence=message.sequence, area=area, tracks=message
    )
