"""The replicas of one service that live, as one of them sees them."""

from common.runtime.assignment import CAPACITY_MAX, owner, turns

SILENT_S = 1.2  # [s] without a heartbeat, two of which come in a second, that means: it hangs


class Team:
    """Who is there, by liveliness tokens and heartbeats.

    A token vanishes with its process, in milliseconds. A process that hangs keeps its token for
    seconds, but sends no heartbeats. This process itself counts once it says so.

    Args:
        me: Name of this replica.
    """

    def __init__(self, me: str) -> None:
        self.order: tuple[str, ...] = ()  # whose turn it is, see common.runtime.assignment
        self._me = me
        self._capacities: dict[str, int] = {}
        self._signs_s: dict[str, float] = {}  # last sign of life
        self._stalled: set[str] = set()

    def came(self, name: str, capacity: int, now_s: float) -> None:
        """Note a token; one with a capacity out of range is none."""
        if 1 <= capacity <= CAPACITY_MAX:
            self._capacities[name] = capacity
            self._signs_s[name] = now_s
            self._stalled.discard(name)

    def went(self, name: str, capacity: int) -> None:
        """Note that a token vanished; the same name may be back with another capacity by now."""
        if self._capacities.get(name) == capacity:
            del self._capacities[name]

    def heard(self, name: str, works: bool, now_s: float) -> None:
        """Note a heartbeat.

        Args:
            name: Who sent it.
            works: Whether it says that it gets on with its work.
            now_s: Monotonic time in seconds.
        """
        self._signs_s[name] = now_s
        (self._stalled.discard if works else self._stalled.add)(name)

    def excuse(self, duration_s: float) -> None:
        """Take a time out of all silences in which this process itself did not get on."""
        self._signs_s = {name: sign_s + duration_s for name, sign_s in self._signs_s.items()}

    def update(self, now_s: float) -> bool:
        """Find who lives now; return whether that has changed."""
        living = {name: c for name, c in self._capacities.items() if self._lives(name, now_s)}
        order = turns(living)
        changed, self.order = order != self.order, order
        return changed

    def does(self, camera: str, sequence: int) -> str | None:
        """Return who does a message, None if nobody lives."""
        return owner(self.order, camera, sequence)

    def _lives(self, name: str, now_s: float) -> bool:
        if name == self._me:
            return True
        return name not in self._stalled and now_s - self._signs_s[name] < SILENT_S
