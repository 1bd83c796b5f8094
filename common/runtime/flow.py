"""Whether what a node lives on comes, and whether it is worked off."""

from collections import deque
from collections.abc import Mapping, Sequence

from people4d.topics import BY_NAME, Topic

QUIET_S = 3.0  # [s] without a message after which a stream counts as missing
WINDOW_S = 3.0  # [s] over which losses are counted
LOST_SHARE = 0.1  # of what comes; less is told by the counters only
LOST_MIN = 3  # messages, so that a single one makes no alarm


class Flow:
    """Judges a process by its counters, which it is shown again and again.

    Args:
        takes: Streams without which the process can do nothing.
        gives: Streams that it sends by itself.
        now_s: Monotonic time in seconds.
    """

    def __init__(self, takes: Sequence[Topic], gives: Sequence[Topic], now_s: float) -> None:
        self._streams = [(topic.name, f"received_{topic.name}", "come") for topic in takes]
        self._streams += [(topic.name, f"sent_{topic.name}", "been sent") for topic in gives]
        self._changed = {counter: (0, now_s) for _, counter, _ in self._streams}
        self._seen: deque[tuple[float, dict[str, int]]] = deque()

    def missing(self, counters: Mapping[str, int], now_s: float) -> str:
        """Return which stream does not come, one sentence; empty if all do."""
        for name, counter, verb in self._streams:
            count, (before, since_s) = counters.get(counter, 0), self._changed[counter]
            if count != before:
                self._changed[counter] = (count, now_s)
            elif now_s - since_s > QUIET_S:
                what = f"no {name.replace('_', ' ')}"
                if count:
                    return f"{what} for {now_s - since_s:.0f} s"
                return f"{what} have {verb} yet, for {now_s - since_s:.0f} s"
        return ""

    def losing(self, counters: Mapping[str, int], now_s: float) -> str:
        """Return what comes faster than it is worked off, one sentence; empty if nothing does."""
        kept = {n: c for n, c in counters.items() if n.startswith(("received_", "dropped_"))}
        self._seen.append((now_s, kept))
        while len(self._seen) > 1 and now_s - self._seen[1][0] >= WINDOW_S:
            self._seen.popleft()
        then_s, before = self._seen[0]
        elapsed_s = now_s - then_s
        for counter, count in kept.items():
            name = counter.removeprefix("dropped_")
            came = kept.get(f"received_{name}", 0) - before.get(f"received_{name}", 0)
            lost = count - before.get(counter, 0)
            if counter == name or lost < max(LOST_MIN, LOST_SHARE * came) or elapsed_s <= 0:
                continue
            return _told(name, came / elapsed_s, lost / elapsed_s)
        return ""


def _told(name: str, came_hz: float, lost_hz: float) -> str:
    what = name.replace("_", " ")
    if name in BY_NAME and BY_NAME[name].delivery == "newest":
        return f"too slow: of {came_hz:.1f} {what} a second {lost_hz:.1f} are skipped"
    return f"its queue overflows: of {came_hz:.1f} {what} a second {lost_hz:.1f} are lost"
