"""Exchange of people with the trackers of neighbouring areas (docs/method.md, section 29)."""

import secrets
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from common.transport.other_robot import topic_of
from people4d.errors import ConfigError, DecodeError
from people4d.messages import AreaPeople, AreaPerson, Message
from people4d.messages.areas import ID_MAX, PEOPLE_MAX
from people4d.topics import ForeignTopic
from services.tracker.areas.config import SiteAreaConfig
from services.tracker.areas.interface import AreaTracker, KnownPeople
from services.tracker.areas.neighbours import Neighbours
from services.tracker.interface import GalleryEntry, IdCounter, Tracker

SHARE_NS = 250_000_000  # interval of messages to neighbours [ns]
REFRESH_NS = 1_000_000_000  # maximum interval of updates from neighbours' people [ns]
PRESENT_NS = 500_000_000  # maximum time since the last match of a track that counts as present [ns]
# Maximum distance of one person's tracks in two areas [m], its growth [m/s]
REACH_M, REACH_MPS = 1.5, 3.0
# Maximum distance of two tracks of one person [m], minimum distance to other people [m], and
# minimum number of consecutive messages
SAME_M, ALONE_M, SAME_MESSAGES = 0.5, 1.0, 4
NO_VIEWS = 3.0  # distance if a person has no views; above any cosine distance
MATCHES_ALIKE = 15  # maximum difference in matches of equally old identities
COUNTERS = ("identities_taken_over", "identities_joined", "identities_yielded")


class AreaExchange:
    """Exchange of known people with the trackers of neighbours.

    Args:
        config: Configuration of the area.
        frame_id: Frame of the tracks.
        tracker: Tracker of the area.

    Raises:
        ConfigError: The tracker cannot recognise people, or an area is named without a number.
    """

    def __init__(self, config: SiteAreaConfig, frame_id: str, tracker: Tracker) -> None:
        self._config, self._frame_id = config, frame_id
        self._tracker = tracker if isinstance(tracker, AreaTracker) else None
        self.neighbours = Neighbours(config, frame_id)
        self._run = secrets.randbelow(2**53)
        self._due_ns = 0
        self._refreshed_ns: int | None = None
        self._away: set[int] = set()  # people in other areas at the last refresh
        # Number of consecutive messages, by pair of tracks
        self._both: dict[tuple[int, int], int] = {}
        self._sequence = 0
        self._counters = Counter(dict.fromkeys(COUNTERS, 0)) if config.number else Counter[str]()
        if config.neighbours and not config.number:
            raise ConfigError(
                "tracker.area.neighbours needs tracker.area.number",
                "Number the areas of the site 1, 2, 3, ...",
            )
        if config.number and (self._known_people() is None or tracker.ids is None):
            raise ConfigError(
                "this tracker cannot hand identities over between areas",
                "Use tracker.tracker=strongsort3d with strongsort3d.identity.enabled.",
            )
        self._ids = tracker.ids or IdCounter()

    @property
    def counters(self) -> dict[str, int]:
        """Events since the start."""
        return {**self.neighbours.counters, **self._counters}

    def attach(self, name: str) -> Sequence[ForeignTopic]:
        """Set the name of this area; return the topics of this area and its neighbours.

        Raises:
            ConfigError: The area is its own neighbour, or a neighbour is named twice.
        """
        self.neighbours.name, neighbours = name, self._config.neighbours
        if not self._config.number:
            return ()
        if name in neighbours:
            raise ConfigError(
                f"area {name} is its own neighbour",
                "Leave it out of tracker.area.neighbours; --robot names the area.",
            )
        if len(set(neighbours)) < len(neighbours):
            raise ConfigError("tracker.area.neighbours: expected each name once, got one twice")
        return [topic_of(area, AreaPeople, partial(_of_area, area)) for area in (name, *neighbours)]

    def receive(self, message: AreaPeople, now_ns: int, time_ns: int | None) -> None:
        """Process a message of a neighbour, or of another process with the name of this area.

        Args:
            message: Message from the other process.
            now_ns: Monotonic time.
            time_ns: Time of frames that arrive now; None before the first frame.
        """
        known = self._known_people()
        if message.run == self._run or known is None:
            return
        self.neighbours.add_message(message, known.embedder, now_ns, time_ns)
        self._refreshed_ns = None

    def refresh(self, time_ns: int, now_ns: int) -> None:
        """Pass the people of neighbours to the tracker, before it tracks a frame.

        Args:
            time_ns: Time of the frame.
            now_ns: Monotonic time of its arrival.
        """
        last_ns = self._refreshed_ns
        if not self.neighbours or (last_ns is not None and now_ns - last_ns < REFRESH_NS):
            return
        is_heard, self._refreshed_ns = last_ns is None, now_ns
        known = self._known_people()
        if known is None or self._tracker is None:
            return
        people = self.neighbours.people(self._ids, time_ns, now_ns)
        self._count_taken_over(known.entries, people)
        self._tracker.learn_neighbours(people)
        yielded = dict.fromkeys(_tracked_elsewhere(known.entries, people, time_ns))
        joined = self._joined(known.entries, people, time_ns) if is_heard else {}
        self._counters["identities_yielded"] += len(yielded)
        self._counters["identities_joined"] += len(joined)
        self._tracker.rename(yielded | joined)

    def due(self, now_ns: int, time_ns: int | None) -> list[Message]:
        """Return the message to neighbours if it is due; arguments as in `hear`."""
        if not self._config.number or now_ns < self._due_ns:
            return []
        self.neighbours.start(now_ns)
        self._due_ns = now_ns + SHARE_NS
        known = self._known_people()
        if time_ns is None or known is None:
            return []
        self._sequence += 1
        oldest_ns = time_ns - self._config.memory_s * 1e9
        recent = [(i, e) for i, e in known.entries.items() if e.matched_ns >= oldest_ns and e.views]
        people = tuple(
            AreaPerson(
                id=identity,
                position_m=entry.position_m,
                unmatched_s=max(time_ns - entry.matched_ns, 0) / 1e9,
                matches=max(entry.matches, 1),
                views=np.asarray(entry.views, np.float32),
            )
            for identity, entry in recent[-PEOPLE_MAX:]  # recently seen people are last
            if identity <= ID_MAX
        )
        message = AreaPeople(
            stamp_ns=time_ns,
            sequence=self._sequence - 1,
            area=self.neighbours.name,
            number=self._config.number,
            run=self._run,
            frame_id=self._frame_id,
            embedder=known.embedder,
            people=people,
        )
        return [message]

    def wake_ns(self) -> int | None:
        """Return the monotonic time of the next message to neighbours."""
        return self._due_ns if self._config.number else None

    def _known_people(self) -> KnownPeople | None:
        return self._tracker.known_people() if self._tracker else None

    def _joined(
        self, own: Mapping[int, GalleryEntry], people: Mapping[int, GalleryEntry], time_ns: int
    ) -> dict[int, int]:
        """Return identities of neighbours by own identity, for people whom both areas track.

        The tracker with fewer matches takes the identity of the other one.
        """
        pairs = _tracked_by_both(own, people, time_ns)
        self._both = {pair: self._both.get(pair, 0) + 1 for pair in pairs}
        joined = {}
        for (mine, theirs), messages in self._both.items():
            more = people[theirs].matches - own[mine].matches
            is_older = more > 0 if abs(more) > MATCHES_ALIKE else theirs < mine
            if messages >= SAME_MESSAGES and is_older:
                joined[mine] = theirs
        return joined

    def _count_taken_over(
        self, own: Mapping[int, GalleryEntry], people: Mapping[int, GalleryEntry]
    ) -> None:
        """Count people handed over from other areas."""
        away = {
            identity
            for identity, entry in people.items()
            if identity not in own or own[identity].matched_ns < entry.matched_ns - PRESENT_NS
        }
        self._counters["identities_taken_over"] += len((own.keys() & self._away) - away)
        self._away = away


def _tracked_elsewhere(
    own: Mapping[int, GalleryEntry], people: Mapping[int, GalleryEntry], time_ns: int
) -> Iterator[int]:
    """Yield own identities that a neighbour tracks at another place, with more matches.

    The area with fewer matches has confused the person with another one.
    """
    for identity, theirs in people.items():
        mine = own.get(identity)
        if mine is None or time_ns - min(mine.matched_ns, theirs.matched_ns) > PRESENT_NS:
            continue
        apart_s = abs(mine.matched_ns - theirs.matched_ns) / 1e9
        distance_m = float(np.linalg.norm(mine.position_m - theirs.position_m))
        if distance_m > REACH_M + REACH_MPS * apart_s and mine.matches < theirs.matches:
            yield identity


def _tracked_by_both(
    own: Mapping[int, GalleryEntry], people: Mapping[int, GalleryEntry], time_ns: int
) -> list[tuple[int, int]]:
    """Return pairs of an own and a neighbour's identity whose tracks show one person now.

    If several people are near, the pair with the most similar views is matched.
    """
    oldest_ns = time_ns - PRESENT_NS
    here = [i for i, entry in own.items() if entry.matched_ns >= oldest_ns]
    there = [i for i, entry in people.items() if entry.matched_ns >= oldest_ns]
    if not here or not there:
        return []
    a_m = np.array([own[i].position_m[:2] for i in here])
    b_m = np.array([people[i].position_m[:2] for i in there])
    distance_m = np.linalg.norm(a_m[:, None] - b_m, axis=-1)
    unlike = np.full(distance_m.shape, np.inf)
    for i, j in np.argwhere(distance_m < ALONE_M):
        unlike[i, j] = _unlikeness(own[here[i]], people[there[j]])
    alike = (unlike <= unlike.min(axis=0)) & (unlike <= unlike.min(axis=1)[:, None])
    alone = (unlike < np.inf).sum(axis=0) * (unlike < np.inf).sum(axis=1)[:, None] == 1
    known = (unlike < NO_VIEWS) | alone
    pairs = [(here[i], there[j]) for i, j in np.argwhere(alike & known & (distance_m < SAME_M))]
    taken = {*here} & {*there}  # identities that both areas have
    return [(a, b) for a, b in pairs if a != b and a not in taken and b not in taken]


def _unlikeness(mine: GalleryEntry, theirs: GalleryEntry) -> float:
    """Return the minimum cosine distance of the views of two people; NO_VIEWS if one has none."""
    a, b = mine.views, theirs.views
    if not a or not b or len(a[0]) != len(b[0]):
        return NO_VIEWS
    return 1 - float((np.array(a) @ np.array(b).T).max())


def _of_area(area: str, message: AreaPeople) -> AreaPeople:
    """Return a message; DecodeError if it comes from another area."""
    if message.area != area:
        raise DecodeError(f"area_people: expected area {area}, got {message.area}")
    return message
