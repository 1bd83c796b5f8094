"""Approximate time synchronisation of colour and depth, like message_filters' ApproximateTime."""

from collections import deque
from typing import Generic, Literal, TypeVar

T = TypeVar("T")

Stream = Literal["colour", "depth"]

MAX_WAITING = 60  # maximum number of waiting images of one stream: two seconds at 30 Hz


class Pairing(Generic[T]):
    """Pairs each colour image with the nearest depth image in time, each used once.

    A pair is returned once no later image can be nearer: immediately for equal stamps, else with
    the next image of the earlier stream. A lost image loses one pair and shifts no other. Images
    farther apart than `slop_ns` are not paired.
    """

    def __init__(self, slop_ns: int) -> None:
        self._slop_ns = slop_ns
        self._waiting: dict[Stream, deque[tuple[int, int, T]]] = {
            "colour": deque(),
            "depth": deque(),
        }
        self._arrivals = 0
        self.unpaired = 0  # number of images without a partner

    def add_image(self, stream: Stream, stamp_ns: int, image: T) -> list[tuple[T, T]]:
        """Add one image of any type, and return the final pairs, oldest first."""
        self._arrivals += 1
        waiting = self._waiting[stream]
        waiting.append((stamp_ns, self._arrivals, image))
        if len(waiting) > MAX_WAITING:
            self._drop(stream)
        return self._final_pairs(ended=False)

    def flush(self) -> list[tuple[T, T]]:
        """Return the last pairs and drop the rest."""
        pairs = self._final_pairs(ended=True)
        for stream, waiting in self._waiting.items():
            while waiting:
                self._drop(stream)
        return pairs

    def _final_pairs(self, ended: bool) -> list[tuple[T, T]]:
        pairs: list[tuple[T, T]] = []
        colours, depths = self._waiting["colour"], self._waiting["depth"]
        while colours and depths:
            earlier: Stream = "colour" if colours[0][0] <= depths[0][0] else "depth"
            gap_ns = abs(colours[0][0] - depths[0][0])
            if gap_ns > self._slop_ns:
                # By arrival, not by stamp: after a clock jump the later image has the older stamp.
                self._drop("colour" if colours[0][1] < depths[0][1] else "depth")
                continue
            queue, partner = self._waiting[earlier], depths if earlier == "colour" else colours
            if len(queue) > 1 and abs(queue[1][0] - partner[0][0]) < gap_ns:
                self._drop(earlier)
            elif len(queue) > 1 or gap_ns == 0 or ended:
                pairs.append((colours.popleft()[2], depths.popleft()[2]))
            else:
                break
        return pairs

    def _drop(self, stream: Stream) -> None:
        self._waiting[stream].popleft()
        self.unpaired += 1
