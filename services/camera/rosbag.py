"""RGB-D frames from ROS 1 bags, ROS 2 bags and MCAP files, without ROS."""

from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from common.errors import DecodeError
from common.messages import Odometry
from services.camera.pairing import Pairing
from services.camera.ros_bag import open_bag
from services.camera.ros_calibration import odometry_of
from services.camera.ros_camera import RosbagOptions, read_camera
from services.camera.ros_images import colour_image, depth_image
from services.camera.ros_topics import Topics, find_topics
from services.camera.source import Capture, Source

LOOSE_NS = 50_000_000  # pairs further apart are counted: a walking person moves by 7 cm

Stamped = tuple[int, Any]  # stamp in nanoseconds and an image message


class RosbagSource(Source):
    """Plays the colour and depth images of a bag.

    Args:
        path: .bag, .db3 or .mcap file, or the folder of a ROS 2 bag.
        options: Topics and the like.

    Raises:
        SourceError: The bag cannot be read, or lacks colour, depth or calibration.
    """

    def __init__(self, path: Path, options: RosbagOptions) -> None:
        self.counters: Counter[str] = Counter()
        self._path = path
        self._slop_ns = int(options.sync_slop_s * 1e9)
        with open_bag(path) as bag:
            self.topics = find_topics(bag.types, _wanted(options))
            camera = read_camera(bag, self.topics, options)
        self.info = camera.info
        self.transforms = camera.transforms
        self.registration = camera.registration

    def __iter__(self) -> Iterator[Capture | Odometry]:
        """Yield pairs of colour and depth, and odometry, in the order of the bag."""
        pairing = Pairing[Stamped](self._slop_ns)
        wanted = {self.topics.colour, self.topics.depth, self.topics.odometry} - {""}
        before = Counter(self.counters)
        # Opened here, by the thread that reads: SQLite insists.
        with open_bag(self._path) as bag:
            for topic, time_ns, message in bag.messages(wanted):
                stamp_ns = self._stamp(message, time_ns)
                if topic == self.topics.odometry:
                    yield from self._odometry(message, stamp_ns)
                else:
                    yield from self._captures(self._pair(pairing, topic, (stamp_ns, message)))
                self.counters["bad_messages"] = before["bad_messages"] + bag.bad_messages
                self.counters["unpaired"] = before["unpaired"] + pairing.unpaired
            yield from self._captures(pairing.flush())
            self.counters["unpaired"] = before["unpaired"] + pairing.unpaired

    def _pair(
        self, pairing: Pairing[Stamped], topic: str, image: Stamped
    ) -> list[tuple[Stamped, Stamped]]:
        stamp_ns, message = image
        if self.topics.colour == self.topics.depth:
            return [((stamp_ns, message.rgb), (stamp_ns, message.depth))]
        return pairing.add("colour" if topic == self.topics.colour else "depth", stamp_ns, image)

    def _captures(self, pairs: Iterable[tuple[Stamped, Stamped]]) -> Iterator[Capture]:
        for (stamp_ns, colour), (depth_stamp_ns, depth) in pairs:
            try:
                rgb, depth_mm = colour_image(colour), depth_image(depth)
                if self.registration:
                    depth_mm = self.registration(depth_mm)
            except (DecodeError, ValueError):  # ValueError: depth changed its size
                self.counters["bad_images"] += 1
                continue
            if abs(stamp_ns - depth_stamp_ns) > LOOSE_NS:
                self.counters["loose_pairs"] += 1
            yield Capture(rgb, depth_mm, stamp_ns)

    def _odometry(self, message: Any, stamp_ns: int) -> Iterator[Odometry]:
        try:
            odometry = odometry_of(message, stamp_ns, self.counters["odometry"])
        except DecodeError:
            self.counters["bad_odometry"] += 1
            return
        self.counters["odometry"] += 1
        yield odometry

    def _stamp(self, message: Any, time_ns: int) -> int:
        """Return the stamp of the header; a driver that leaves it empty gets the bag's time."""
        stamp = message.header.stamp
        stamp_ns = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
        if stamp_ns == 0:
            self.counters["zero_stamps"] += 1
        return stamp_ns or time_ns


def _wanted(options: RosbagOptions) -> Topics:
    return Topics(
        options.colour_topic,
        options.depth_topic,
        options.colour_info_topic,
        options.depth_info_topic,
        options.odometry_topic,
    )
