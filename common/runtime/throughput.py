"""Missing streams and lost messages, found from the counters of a process."""

from collections import deque
from collections.abc import Mapping, Sequence

from people4d.topics import BY_NAME, Topic

QUIET_S = 3.0  # maximum silence of a stream [s]
WINDOW_S = 3.0  # period of the losses [s]
LOST_RATIO = 0.1  # minimum reported share of lost messages
LOST_MIN = 3  # minimum reported number of lost messages

# Counters of progress; all others count drops or other events by their cause.
PROGRESS = {
    "frames",
    "people",
    "with_position",
    "with_heading",
    "odometry",
    "pictures",
    "images",
    "viewers",
    "viewers_served",
    "history_mb",
    "predictions",
    "people_unknown",
}
# Prefixes of counters of progress; "left_": messages that another replica handles
PROGRESS_PREFIXES = ("received_", "sent_", "left_", "taken_over_")


class Throughput:
    """Finds missing streams and losses in the periodic counters of a process.

    Args:
        inputs: Streams that the process requires.
        outputs: Streams that the process publishes without inputs.
        now_s: Monotonic time in seconds.
    """

    def __init__(self, inputs: Sequence[Topic], outputs: Sequence[Topic], now_s: float) -> None:
        self._streams = [(topic.name, f"received_{topic.name}", "come") for topic in inputs]
        self._streams += [(topic.name, f"sent_{topic.name}", "been sent") for topic in outputs]
        self._changed = {counter: (0, now_s) for _, counter, _ in self._streams}
        self._samples: deque[tuple[float, dict[str, int]]] = deque()

    def missing(self, counters: Mapping[str, int], now_s: float) -> str:
        """Describe a missing stream in one sentence; empty if there is none."""
        for name, counter, verb in self._streams:
            count, (before, since_s) = counters.get(counter, 0), self._changed[counter]
            if count != before:
                self._changed[counter] = (count, now_s)
            elif now_s - since_s > QUIET_S:
                stream = f"no {name.replace('_', ' ')}"
                if count:
                    return f"{stream} for {now_s - since_s:.0f} s"
                return f"{stream} have {verb} yet, for {now_s - since_s:.0f} s"
        return ""

    def losing(self, counters: Mapping[str, int], now_s: float) -> str:
        """Describe a stream that overruns the process in one sentence; empty if none does."""
        inputs = {n: c for n, c in counters.items() if n.startswith(("received_", "dropped_"))}
        self._samples.append((now_s, inputs))
        while len(self._samples) > 1 and now_s - self._samples[1][0] >= WINDOW_S:
            self._samples.popleft()
        then_s, before = self._samples[0]
        elapsed_s = now_s - then_s
        for counter, count in inputs.items():
            name = counter.removeprefix("dropped_")
            received = inputs.get(f"received_{name}", 0) - before.get(f"received_{name}", 0)
            lost = count - before.get(counter, 0)
            if counter == name or lost < max(LOST_MIN, LOST_RATIO * received) or elapsed_s <= 0:
                continue
            return _format_loss(name, received / elapsed_s, lost / elapsed_s)
        return ""


def losses(counters: Mapping[str, int]) -> dict[str, int]:
    """Return the counters of losses that are not zero, sorted by name."""
    return {
        name: count
        for name, count in sorted(counters.items())
        if count and name not in PROGRESS and not name.startswith(PROGRESS_PREFIXES)
    }


def _format_loss(name: str, received_hz: float, lost_hz: float) -> str:
    stream = name.replace("_", " ")
    if name in BY_NAME and BY_NAME[name].delivery == "newest":
        return f"too slow: of {received_hz:.1f} {stream} a second {lost_hz:.1f} are skipped"
    return f"its queue overflows: of {received_hz:.1f} {stream} a second {lost_hz:.1f} are lost"
