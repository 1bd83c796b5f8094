"""Live RGB-D frames of a camera driver in ROS 2, received without ROS."""

import time
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import closing
from functools import partial
from typing import Any, ClassVar

import msgspec

from common.ros2 import types
from common.ros2.config import Ros2Config
from common.ros2.transforms import edges_of, stamp_of
from common.ros2.transport import SENSOR_DATA, Qos, Ros2Sample, Ros2Transport
from common.ros2.transports import open_transport
from common.text import listed
from people4d.errors import DecodeError
from people4d.messages import Odometry
from people4d.messages.base import Positive
from services.camera.folder.pairing import Pairing
from services.camera.ros.camera import RosbagOptions
from services.camera.ros.drivers import candidates, image_kind, info_topic
from services.camera.ros.images import colour_image, depth_image
from services.camera.ros.live_camera import LiveCamera
from services.camera.ros.motion import MotionReader
from services.camera.ros.sample_queue import IMAGES_MAX, OTHERS_MAX, SampleQueue, TopicSample
from services.camera.ros.topics import CAMERA_INFO, JOINTS, ODOMETRY, RGBD, TF, Topics
from services.camera.source import MotionMessage, Source, SourceFrame, SourceItem

STATIC = Qos("reliable", "transient_local", 100)  # one message per publishing node
POLL_S = 0.2
SETTLE_S = 0.5  # [s] wait for better topics after the first images
TF_WAIT_S = 1.0  # [s] wait for transforms before the first frame
SHOWN = 4  # maximum number of topics in a message
COUNTERS = ("bad_message", "bad_images", "tf_loops", "unlinked_frames", "uncalibrated")


class LiveRosOptions(RosbagOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Options of live topics.

    If a topic is empty, the driver's default is used; if the odometry topic is empty, odometry is
    not read.
    """

    namespace: str = ""  # namespace of the driver; empty: the source's, else the driver's default
    sync_slop_s: Positive = 0.1  # [s] maximum distance in time of colour and depth
    # Topics of TFMessage; names that end in tf_static are latched
    tf_topics: tuple[str, ...] = ("/tf", "/tf_static")
    # Frame of the robot that carries the camera in /tf; empty: the base of odometry
    base_frame: str = ""
    timeout_s: Positive = 3.0  # [s] maximum silence of a topic before it is reported
    # connection; the transport is part of the source
    ros2: Ros2Config = Ros2Config(node="people4d_camera")


class LiveRosSource(Source):
    """Receives a camera's topics; ConfigError if the source or an option is wrong.

    Of a driver's possible topics the preferred delivering one is used. Calibration and mount follow
    the messages, since a driver may start later or change its resolution.
    """

    options_type = LiveRosOptions
    live = True
    calibrates_late: ClassVar[bool] = True

    def __init__(self, source: str, options: LiveRosOptions) -> None:
        self.counters: Counter[str] = Counter(dict.fromkeys(COUNTERS, 0))
        self._options = options
        self._candidates = candidates(
            source, options.namespace, options.colour_topic, options.depth_topic
        )
        transport: Any = self._candidates.transport
        self._config = msgspec.structs.replace(options.ros2, transport=transport)
        self._queue = SampleQueue(self.counters)
        self._pairing = Pairing[tuple[int, Any]](int(options.sync_slop_s * 1e9))
        self._motion = MotionReader(self.counters, options.wheels, options.map_frame)
        self._stamps: dict[str, int] = {}  # last stamp in a header, by topic
        self._since_s = 0.0
        self.problem = "waits for the first messages"

    def __iter__(self) -> Iterator[SourceItem]:
        """Yield calibration, frames and motion until closed."""
        while not self._queue.closed:
            chosen = self._choose()
            if chosen:
                yield from self._play(*chosen)

    def interrupt(self) -> None:
        """End the iteration soon."""
        self._queue.close()

    def _choose(self) -> tuple[str, str] | None:
        """Receive all possible topics of the driver; return the preferred delivering ones."""
        images = (*self._candidates.colours, *self._candidates.depths)
        if len(set(images)) <= 2:
            return self._candidates.colours[0], self._candidates.depths[0]
        first_s: float | None = None
        with closing(self._receive({topic: image_kind(topic) for topic in images})) as received:
            while not self._queue.closed:
                self._queue.get(POLL_S)
                received.count()
                chosen = self._candidates.choose(self._queue.last_s)
                now_s = time.monotonic()
                if chosen:
                    first_s = first_s or now_s
                    if now_s > first_s + SETTLE_S:
                        return chosen
                elif now_s > self._since_s + self._options.timeout_s:
                    self.problem = self._silence(images)
        return None

    def _play(self, colour: str, depth: str) -> Iterator[SourceItem]:
        options = self._options
        if colour == depth:  # RGBD messages contain both CameraInfo
            infos: tuple[str, str] = ("rgb_camera_info", "depth_camera_info")
            kinds: dict[str, str] = {}
        else:
            infos = (
                options.colour_info_topic or info_topic(colour),
                options.depth_info_topic or info_topic(depth),
            )
            kinds = dict.fromkeys(infos, CAMERA_INFO)
        topics = Topics(colour, depth, *infos, options.odometry_topic)
        kinds |= {topic: image_kind(topic) for topic in (colour, depth)}
        kinds |= dict.fromkeys(options.tf_topics, TF)
        kinds |= {topic: ODOMETRY for topic in (options.odometry_topic,) if topic}
        kinds |= dict.fromkeys(options.wheel_topics, JOINTS)
        camera = LiveCamera(topics, options, self.counters)
        if options.base_frame:
            camera.add_base("", options.base_frame)
        with closing(self._receive(kinds)) as received:
            while not self._queue.closed:
                sample = self._queue.get(POLL_S)
                received.count()
                if sample:
                    yield from self._items(sample, kinds[sample.topic], topics, camera)
                silent = self._silent((colour, depth))
                self.problem = self._silence(silent) if silent else camera.problem
                if len(silent) == len({colour, depth}) and len(self._candidates.colours) > 1:
                    return  # the driver may have restarted with other topics

    def _receive(self, kinds: dict[str, str]) -> "_Received":
        """Receive topics of some types, after dropping waiting messages."""
        self._queue.clear()
        self._since_s = time.monotonic()
        transport = open_transport(self._config)
        for topic, kind in kinds.items():
            image = "Image" in kind or kind == RGBD
            latched = kind == TF and topic.endswith("tf_static")
            qos = STATIC if latched else SENSOR_DATA
            most = IMAGES_MAX if image else OTHERS_MAX
            transport.subscribe(topic, kind, partial(self._put, topic, most), qos)
        return _Received(transport, self.counters)

    def _put(self, topic: str, most: int, sample: Ros2Sample) -> None:
        self._queue.add_sample(topic, sample.cdr, sample.sent_ns, most)

    def _items(
        self, sample: TopicSample, kind: str, topics: Topics, camera: LiveCamera
    ) -> Iterator[SourceItem]:
        try:
            message = types.decode(kind, sample.cdr)
        except DecodeError:
            self.counters["bad_message"] += 1
            return
        if kind == CAMERA_INFO:
            camera.add_info(sample.topic, message)
        elif kind == TF:
            yield from self._transforms(sample, message, camera)
        elif kind in (ODOMETRY, JOINTS):
            yield from self._odometry(sample, kind, message, camera)
        else:
            yield from self._images(sample, kind, message, topics, camera)

    def _images(
        self, sample: TopicSample, kind: str, message: Any, topics: Topics, camera: LiveCamera
    ) -> Iterator[SourceItem]:
        stamp_ns = self._stamp(message, sample)
        if stamp_ns is None:
            return
        if kind == RGBD:
            camera.add_info(topics.colour_info, message.rgb_camera_info)
            camera.add_info(topics.depth_info, message.depth_camera_info)
            yield from self._frame(stamp_ns, message.rgb, message.depth, camera)
            return
        stream: Any = "colour" if sample.topic == topics.colour else "depth"
        pairs = self._pairing.add_image(stream, stamp_ns, (stamp_ns, message))
        self.counters["unpaired"] = self._pairing.unpaired
        for (colour_ns, colour), (_, depth) in pairs:
            yield from self._frame(colour_ns, colour, depth, camera)

    def _frame(
        self, stamp_ns: int, colour: Any, depth: Any, camera: LiveCamera
    ) -> Iterator[SourceItem]:
        early = time.monotonic() < self._since_s + TF_WAIT_S
        if early and self._options.tf_topics and not (camera.camera or camera.knows_frames):
            return
        try:
            rgb, depth_mm = colour_image(colour), depth_image(depth)
        except DecodeError:
            self.counters["bad_images"] += 1
            return
        frames = (str(message.header.frame_id).strip("/") for message in (colour, depth))
        colour_frame, depth_frame = frames
        size: Any = rgb.shape[:2]
        depth_size: Any = depth_mm.shape
        setup = camera.setup((size, colour_frame), (depth_size, depth_frame), stamp_ns)
        if setup:
            yield setup
        if camera.camera is None:
            self.counters["uncalibrated"] += 1
            return
        yield SourceFrame(*camera.camera.alignment(rgb, depth_mm), stamp_ns)

    def _transforms(
        self, sample: TopicSample, message: Any, camera: LiveCamera
    ) -> Iterator[MotionMessage]:
        static = self._options.tf_as_static or sample.topic.endswith("tf_static")
        edges = list(edges_of(message))
        usable = [edge for edge in edges if edge.parent and edge.child]
        self.counters["bad_transforms"] += len(edges) - len(usable)
        for edge in usable:
            camera.add_edge(edge, static)
        moving = camera.camera.moving if camera.camera else ()
        yield from self._motion.transforms(usable, moving, sample.received_ns)

    def _odometry(
        self, sample: TopicSample, kind: str, message: Any, camera: LiveCamera
    ) -> Iterator[Odometry]:
        stamp_ns = self._stamp(message, sample)
        if stamp_ns is None:
            return
        for odometry in self._motion.odometry(kind, message, stamp_ns):
            if not self._options.base_frame:
                camera.add_base(odometry.frame_id, odometry.child_frame_id)
            yield odometry

    def _stamp(self, message: Any, sample: TopicSample) -> int | None:
        """Return the stamp of the header, or the time of reception if a driver leaves it empty.

        None for the first message if it has none: a simulation begins at 0 s, too.
        """
        stamp_ns, before_ns = stamp_of(message), self._stamps.get(sample.topic)
        self._stamps[sample.topic] = stamp_ns
        if stamp_ns:
            return stamp_ns
        self.counters["zero_stamps"] += 1
        return None if before_ns is None else sample.received_ns

    def _silent(self, topics: Iterable[str]) -> list[str]:
        """Return the topics without a message for `timeout_s`."""
        before_s = time.monotonic() - self._options.timeout_s
        last_s = self._queue.last_s
        return [topic for topic in topics if last_s.get(topic, self._since_s) < before_s]

    def _silence(self, topics: Iterable[str]) -> str:
        silent = self._silent(dict.fromkeys(topics))
        return f"no messages on {listed(silent, SHOWN, 'topics')}" if silent else ""


class _Received:
    """A transport that adds its counters to the counters of the source."""

    def __init__(self, transport: Ros2Transport, counters: Counter[str]) -> None:
        self._transport = transport
        self._counters = counters
        self._counted = Counter[str]()

    def count(self) -> None:
        """Add counts since the last call."""
        now = Counter(self._transport.counters)
        self._counters.update(now - self._counted)
        self._counted = now

    def close(self) -> None:
        """End the subscriptions."""
        self._transport.close()
        self.count()
