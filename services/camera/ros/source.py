"""RGB-D frames from ROS 1 bags, ROS 2 bags and MCAP files, without ROS."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from common.io.ros_bag import Bag
from common.ros2.transforms import edges_of, stamp_of
from people4d.errors import DecodeError, SourceError
from services.camera.folder.pairing import Pairing
from services.camera.ros.camera import RosbagOptions, read_camera
from services.camera.ros.heads import MILLIMETRE, depth_unit_m, encodings, simulated_topics
from services.camera.ros.images import colour_image, depth_image, millimetres
from services.camera.ros.motion import MotionReader
from services.camera.ros.topics import JOINTS, ODOMETRY, OLD_TF, TF, Topics, find_topics, open_bag
from services.camera.source import MotionMessage, Source, SourceFrame

NUMBER = re.compile(r"std_msgs/msg/(U?Int(8|16|32|64)|Float(32|64))")
# [ns] time difference from which pairs are counted as loose: 7 cm of a walking person
LOOSE_NS = 50_000_000

StampedImage = tuple[int, Any]  # stamp in nanoseconds and an image message


class RosbagSource(Source):
    """Plays a bag; SourceError if it is damaged, or lacks colour, depth or calibration."""

    options_type = RosbagOptions

    def __init__(self, path: Path, options: RosbagOptions) -> None:
        self.counters: Counter[str] = Counter()
        self._path = path
        self._slop_ns = int(options.sync_slop_s * 1e9)
        self._options = options
        with open_bag(path) as bag:
            wanted = Topics(
                options.colour_topic,
                options.depth_topic,
                options.colour_info_topic,
                options.depth_info_topic,
                options.odometry_topic,
            )
            # Odometry topics are replaced by wheels
            unused = ODOMETRY if options.wheel_topics else ""
            types = {topic: kind for topic, kind in bag.types.items() if kind != unused}
            self.topics = find_topics(types, wanted, partial(encodings, bag))
            camera = read_camera(bag, self.topics, options)
            self._unit_m = depth_unit_m(bag, self.topics.depth)
            _check_wheels(bag, options.wheel_topics)
            self._moving = camera.moving
            self.moves = bool(self._moving)
            self._motion = options.wheel_topics or (self.topics.odometry,)
            self._tf = {
                topic for topic, kind in bag.types.items() if kind in (TF, OLD_TF) and self.moves
            }
            self._simulated = simulated_topics(bag, self._played)
        self.info = camera.alignment.info
        self.transforms = camera.transforms
        self.alignment, self.registration = camera.alignment, camera.alignment.registration

    @property
    def _played(self) -> set[str]:
        return {self.topics.colour, self.topics.depth, *self._motion, *self._tf} - {""}

    def __iter__(self) -> Iterator[SourceFrame | MotionMessage]:
        """Yield pairs of colour and depth, and motion, in the order of the bag."""
        pairing = Pairing[StampedImage](self._slop_ns)
        motion = MotionReader(self.counters, self._options.wheels, self._options.map_frame)
        before = Counter(self.counters)
        # SQLite requires opening in the reading thread.
        with open_bag(self._path) as bag:
            for topic, time_ns, message in bag.messages(self._played):
                if topic in self._tf:
                    default_ns = 0 if topic in self._simulated else time_ns
                    yield from motion.transforms(edges_of(message), self._moving, default_ns)
                elif topic in self._motion:
                    kind = bag.types[topic]
                    stamped = kind in (
                        ODOMETRY,
                        JOINTS,
                    )  # a plain number, as of wheels, has no stamp
                    stamp_ns = self._stamp(topic, message, time_ns) if stamped else time_ns
                    is_left = topic == self._motion[0]
                    yield from motion.odometry(kind, message, stamp_ns, is_left)
                else:
                    stamp_ns = self._stamp(topic, message, time_ns)
                    yield from self._frames(self._pair(pairing, topic, (stamp_ns, message)))
                self.counters["bad_messages"] = before["bad_messages"] + bag.bad_messages
                self.counters["unpaired"] = before["unpaired"] + pairing.unpaired
            yield from self._frames(pairing.flush())
            self.counters["unpaired"] = before["unpaired"] + pairing.unpaired

    def _pair(
        self, pairing: Pairing[StampedImage], topic: str, image: StampedImage
    ) -> list[tuple[StampedImage, StampedImage]]:
        stamp_ns, message = image
        if self.topics.colour == self.topics.depth:
            return [((stamp_ns, message.rgb), (stamp_ns, message.depth))]
        return pairing.add_image(
            "colour" if topic == self.topics.colour else "depth", stamp_ns, image
        )

    def _frames(self, pairs: Iterable[tuple[StampedImage, StampedImage]]) -> Iterator[SourceFrame]:
        for (stamp_ns, colour), (depth_stamp_ns, depth) in pairs:
            try:
                rgb, depth_mm = colour_image(colour), depth_image(depth)
                if self._unit_m != MILLIMETRE:
                    depth_mm = millimetres(depth_mm * self._unit_m)
                rgb, depth_mm = self.alignment(rgb, depth_mm)
            except (DecodeError, ValueError):  # ValueError: depth changed its size
                self.counters["bad_images"] += 1
                continue
            if abs(stamp_ns - depth_stamp_ns) > LOOSE_NS:
                self.counters["loose_pairs"] += 1
            yield SourceFrame(rgb, depth_mm, stamp_ns)

    def _stamp(self, topic: str, message: Any, time_ns: int) -> int:
        """Return the stamp of the header, or the time of the bag if it is empty."""
        stamp_ns = stamp_of(message)
        if stamp_ns or topic in self._simulated:
            return stamp_ns
        self.counters["zero_stamps"] += 1
        return time_ns


def _check_wheels(bag: Bag, topics: tuple[str, ...]) -> None:
    """Check that the wheel topics are one of joints or two of numbers; SourceError otherwise."""
    kinds = [bag.types.get(topic, "absent") for topic in topics]
    numbers = len(kinds) == 2 and all(NUMBER.fullmatch(kind) for kind in kinds)
    if kinds and kinds != [JOINTS] and not numbers:
        got = ", ".join(f"{topic} ({kind})" for topic, kind in zip(topics, kinds, strict=True))
        raise SourceError(
            f"wheel_topics: expected a topic of {JOINTS} or two of a number, got {got}",
            "Use numbers of std_msgs, such as Int32, the left wheel first.",
        )
