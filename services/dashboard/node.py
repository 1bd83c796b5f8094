"""Node of the dashboard: publishes packets to the pages, and their commands."""

import time
from collections import deque
from collections.abc import Sequence
from typing import Any, ClassVar

import msgspec

from common.io.images import decompress
from common.io.plain_json import to_json
from common.io.zones import PlainZone
from common.runtime.node import NO_LOOP, LoopCallbacks, Node, Status
from people4d.codec import decode
from people4d.errors import DecodeError
from people4d.messages import (
    CameraInfo,
    CompressedRgbdFrame,
    Detections,
    Event,
    Health,
    Message,
    MovingTransform,
    Odometry,
    Predictions,
    RgbdFrame,
    Skeletons,
    StaticTransform,
    Target,
    TargetCommand,
    Tracks,
    ZoneEdit,
    Zones,
)
from people4d.topics import Topic
from services.dashboard.config import DashboardConfig
from services.dashboard.history import History, Packet
from services.dashboard.hub import JSON, Demand, Hub
from services.dashboard.overview import Overview
from services.dashboard.scene import SceneBuilder, event_of, predictions_of, skeletons_of
from services.dashboard.selection import FrameSelection, Key
from services.dashboard.server import WebServer, serve_dashboard

PAIR_NS = 1_500_000_000  # maximum wait of detections for their tracks [ns]
EVENTS_MAX = 100  # number of events on a new page
IDLE_HZ = 2.0  # rate of people while no page is open
CLOUD_HZ = 4.0  # maximum rate of depth clouds
HISTORY_BYTES = 64 * 2**20  # maximum size of the history
_pack = msgspec.msgpack.encode


class DashboardNode(Node):
    """Shows the messages of the pipeline; images are decoded only while a page shows them."""

    inputs: tuple[type[Message], ...] = (*(Tracks, CameraInfo, StaticTransform, Event, Zones),)
    inputs_on_demand: ClassVar[tuple[type[Message], ...]] = (
        *(RgbdFrame, CompressedRgbdFrame, Detections, Predictions, Health),
        *(MovingTransform, Odometry, Skeletons, Target),
    )

    def __init__(self, config: DashboardConfig) -> None:
        self._config, self._loop = config, NO_LOOP
        history = History(config.history_s, HISTORY_BYTES)
        self._hub = Hub(history, self._take_demand)
        self._hub.serves_json = config.people_json
        self._selection = FrameSelection(IDLE_HZ)
        self._scenes = SceneBuilder(config.base_frame)
        self._overview = Overview()
        self._server: WebServer | None = None
        self._demand, self._wanted = Demand(), Demand()
        # detections without tracks, and the monotonic time up to which they wait
        self._detected: dict[Key, tuple[Detections, int]] = {}
        self._cloud_ns: dict[str, int] = {}
        self._last: dict[str, tuple[int, dict[str, Any]]] = {}  # newest scene of each camera
        self._events: deque[dict[str, Any]] = deque(maxlen=EVENTS_MAX)
        self._commands: deque[ZoneEdit | TargetCommand] = deque(maxlen=8)
        self._command_sequence = 0
        self._images = self._images_failed = 0

    def attach(self, loop: LoopCallbacks) -> None:
        """Use the callbacks of the loop, and open the page."""
        self._loop = loop
        self._server = serve_dashboard(
            self._config, self._hub, self._take_command, loop.state_folder
        )
        self._hub.about |= {
            "robot": loop.robot,
            "privacy": self._config.privacy,
            "history_s": self._config.history_s,
        }

    def admits(self, topic: Topic, payload: bytes) -> bool:
        """Check that a message belongs to a shown frame."""
        return self._selection.admits(topic.name, payload)

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Send a message to the pages, as far as they show it."""
        self._overview.add_message(message, self._selection)
        if isinstance(message, Detections):
            key = message.camera, message.stamp_ns
            payload = self._selection.take_tracks(key)
            tracks = _decoded(payload)
            if isinstance(tracks, Tracks):
                self._overview.add_message(tracks, self._selection)
                self._show(key, message, tracks)
            else:
                self._detected[key] = message, now_ns + PAIR_NS
        elif isinstance(message, Tracks):
            key = message.camera, message.stamp_ns
            detections, _ = self._detected.pop(key, (None, 0))
            self._show(key, detections, message)
        elif isinstance(message, RgbdFrame | CompressedRgbdFrame):
            self._show_late(message)
        elif isinstance(message, Predictions):
            packet = {"type": "predictions", "people": predictions_of(message)}
            self._publish("predictions", packet)
        elif isinstance(message, Skeletons):
            packet = {"frame": str(message.stamp_ns), "camera": message.camera}
            packet |= skeletons_of(message)
            self._publish(f"skeletons {message.camera}", packet, stamp_ns=message.stamp_ns)
        elif isinstance(message, Target):
            state: dict[str, Any] = {"state": message.state, "id": message.id}
            self._publish("target", {"type": "target", **state, "reason": message.reason})
        elif isinstance(message, Event):
            self._events.append(event_of(message, time.time() * 1000))
            self._publish("events", {"type": "events", "events": list(self._events)}, stays=True)
        elif isinstance(message, Zones):
            zones = [PlainZone.from_zone(zone) for zone in message.zones]
            about: dict[str, Any] = {"base": message.sequence, "problem": message.problem}
            self._publish("zones", {"type": "zones", "zones": zones, **about}, stays=True)
        else:
            self._scenes.add_message(message)
        return ()

    def tick(self, now_ns: int) -> Sequence[Message]:
        """Follow the demand of the pages; send detections without tracks, health and commands."""
        if self._wanted != self._demand:
            self._follow(self._wanted)
        for key, (detections, until_ns) in list(self._detected.items()):
            if now_ns >= until_ns:
                del self._detected[key]
                self._show(key, detections, None)
        if self._demand.viewers:
            for name, packet in self._overview.due(now_ns):
                self._publish(name, packet, stays=True)
        commands = []
        while self._commands:
            self._command_sequence += 1
            sequence = self._command_sequence - 1
            commands.append(msgspec.structs.replace(self._commands.popleft(), sequence=sequence))
        return commands

    def wake_ns(self) -> int | None:
        """Return the time of the next packet [ns]."""
        times = [until_ns for _, until_ns in self._detected.values()]
        if self._demand.viewers:
            times.append(self._overview.due_ns)
        return min(times, default=None)

    def status(self) -> Status:
        """Return the counters."""
        return Status(
            counters={
                **self._hub.counters,
                "images": self._images,
                "bad_images": self._images_failed,
                "viewers": self._hub.viewers,
                "history_mb": self._hub.history.size >> 20,
            }
        )

    def close(self) -> None:
        """Close the page."""
        if self._server:
            self._server.close()

    def _take_demand(self, demand: Demand) -> None:
        self._wanted = demand
        self._loop.wake()

    def _take_command(self, command: ZoneEdit | TargetCommand) -> None:
        self._commands.append(command)
        self._loop.wake()

    def _follow(self, demand: Demand) -> None:
        """Subscribe to the messages that the pages show."""
        images = demand.images and not self._config.privacy
        kinds: list[type[Message]] = []
        if demand.viewers:
            kinds += [Detections, Predictions, Skeletons, Health, MovingTransform, Odometry, Target]
        if images:
            kinds += [RgbdFrame, CompressedRgbdFrame]
        if demand.viewers and not self._demand.viewers:
            self._overview.restart()
        self._selection.rate_hz = self._config.rate_max_hz if demand.viewers else IDLE_HZ
        self._selection.holds_frames = images
        if not images:
            self._selection.clear_frames()
        self._demand = demand
        self._loop.demand(kinds)

    def _show(self, key: Key, detections: Detections | None, tracks: Tracks | None) -> None:
        """Send a frame to the pages: people, image and cloud of one stamp."""
        at_ms = time.time() * 1000
        frame = self._frame(key)
        scene = self._scenes.scene(key, detections, tracks)
        if scene["people"] is not None:
            positions = [(one["id"], *one["position_m"][:2]) for one in scene["people"]]
            self._hub.positions.append({"at_ms": at_ms, "people": positions})
        if tracks and self._demand.json:
            part = JSON, to_json(tracks, self._loop.robot)
            self._hub.publish(Packet(at_ms, f"{JSON} {key[0]}", (part,)))
        self._last[key[0]] = key[1], scene
        self._send(key, {**scene, "at_ms": at_ms}, frame)

    def _show_late(self, frame: RgbdFrame | CompressedRgbdFrame) -> None:
        """Send the newest people of a camera again with their image, which arrived later."""
        stamp_ns, scene = self._last.get(frame.camera, (None, {}))
        if stamp_ns == frame.stamp_ns and self._selection.holds_frames:
            at_ms = time.time() * 1000
            self._send((frame.camera, frame.stamp_ns), {**scene, "at_ms": at_ms}, frame)

    def _send(
        self, key: Key, scene: dict[str, Any], frame: RgbdFrame | CompressedRgbdFrame | None
    ) -> None:
        at_ms, about = scene["at_ms"], {"frame": scene["frame"], "at_ms": scene["at_ms"]}
        parts = [("scene", _pack({**scene, "has_image": frame is not None}))]
        if frame is not None:
            image = self._scenes.image(frame)
            parts.append(("image", _pack({"type": "image", **about, **image})))
            self._images += 1
        cloud = self._cloud(frame) if isinstance(frame, RgbdFrame) else None
        if cloud:
            packed = _pack({"type": "cloud", **about, "camera": key[0], **cloud})
            parts.append(("cloud", packed))
        self._hub.publish(Packet(at_ms, f"scene {key[0]}", tuple(parts), key[1]))

    def _cloud(self, frame: RgbdFrame) -> dict[str, Any] | None:
        """Return the depth cloud of a frame if one is due."""
        now_ns = time.monotonic_ns()
        due_ns = self._cloud_ns.get(frame.camera, 0) + 0.8e9 / CLOUD_HZ
        if not self._demand.cloud or now_ns < due_ns:
            return None
        self._cloud_ns[frame.camera] = now_ns
        return self._scenes.cloud(frame)

    def _frame(self, key: Key) -> RgbdFrame | CompressedRgbdFrame | None:
        """Decode the frame of a camera and stamp, if it is shown and available."""
        payload = self._selection.take_frame(key) if self._selection.holds_frames else None
        frame = _decoded(payload)
        try:
            if isinstance(frame, CompressedRgbdFrame):
                return decompress(frame) if self._demand.cloud else frame
        except DecodeError:
            self._images_failed += 1
        return frame if isinstance(frame, RgbdFrame) else None

    def _publish(
        self, key: str, packet: dict[str, Any], stays: bool = False, stamp_ns: int = 0
    ) -> None:
        at_ms = time.time() * 1000
        data = _pack({"at_ms": at_ms, **packet})
        self._hub.publish(Packet(at_ms, key, ((str(packet["type"]), data),), stamp_ns), stays)


def _decoded(payload: bytes | None) -> Message | None:
    if payload is None:
        return None
    try:
        return decode(payload)
    except DecodeError:
        return None
