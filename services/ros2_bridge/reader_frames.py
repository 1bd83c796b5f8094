"""Transform tree of a reader of ROS: links between frames on /tf, and their newest times."""

import threading
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial

from common.ros2 import types
from common.ros2.messages.basic import TF
from common.ros2.transforms import edges_of
from common.ros2.transport import LATCHED, Qos, Ros2Sample, Ros2Transport

FRAMES_MAX = 4096  # maximum number of frames
ALWAYS_NS = 2**63 - 1  # newest time of static transforms [ns]
COUNTERS = ("tf_loops", "tf_bad")
MANY = 100  # depth of the queues of tf2


class ReaderFrames:
    """Links between frames, without the values of transforms; thread-safe.

    As in tf2, each frame has one parent, the last one received. A parent that would close a loop
    is rejected and counted.

    Args:
        counters: Counts `COUNTERS`.
        on_change: Called after each message.
    """

    def __init__(self, counters: Counter[str], on_change: Callable[[], None]) -> None:
        self._counters, self._on_change = counters, on_change
        self._parents: dict[str, tuple[str, int]] = {}  # parent and newest time [ns] by child
        self._lock = threading.Lock()
        counters.update(dict.fromkeys(COUNTERS, 0))

    def subscribe(self, transport: Ros2Transport) -> None:
        """Subscribe to /tf and /tf_static."""
        transport.subscribe("/tf", TF, partial(self.add_payload, static=False), Qos(depth=MANY))
        latched = Qos(LATCHED.reliability, LATCHED.durability, MANY)
        transport.subscribe("/tf_static", TF, partial(self.add_payload, static=True), latched)

    def add_payload(self, sample: Ros2Sample, static: bool) -> None:
        """Add the transforms of a tf2_msgs/TFMessage; DecodeError for other payloads."""
        message = types.decode(TF, sample.cdr)
        edges = list(edges_of(message))
        self._counters["tf_bad"] += len(message.transforms) - len(edges)
        for edge in edges:
            self.add_transform(edge.parent, edge.child, ALWAYS_NS if static else edge.stamp_ns)
        self._on_change()

    def add_transform(self, parent: str, child: str, stamp_ns: int) -> None:
        """Add a transform at a time [ns], ALWAYS_NS if it is static."""
        with self._lock:
            known = child in self._parents
            if not parent or not child or (not known and len(self._parents) >= FRAMES_MAX):
                self._counters["tf_bad"] += 1
            elif child in (frame for frame, _ in self._climb(parent)):
                self._counters["tf_loops"] += 1
            else:
                before, newest_ns = self._parents.get(child, (parent, stamp_ns))
                newest_ns = max(newest_ns, stamp_ns) if before == parent else stamp_ns
                self._parents[child] = parent, newest_ns

    def newest_ns(self, target: str, source: str) -> int | None:
        """Return the newest time at which two frames are linked [ns]; None if they are not."""
        with self._lock:
            of_source = dict(self._climb(source))
            for frame, newest_ns in self._climb(target):
                if frame in of_source:
                    return min(newest_ns, of_source[frame])
        return None

    def _climb(self, frame: str) -> Iterator[tuple[str, int]]:
        """Yield a frame and its ancestors, each with the newest time of its link to the frame."""
        newest_ns = ALWAYS_NS
        yield frame, newest_ns
        while frame in self._parents:
            frame, stamp_ns = self._parents[frame]
            newest_ns = min(newest_ns, stamp_ns)
            yield frame, newest_ns
