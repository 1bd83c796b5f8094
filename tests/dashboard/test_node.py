"""Node of the dashboard: decoded messages, and packets for pages."""

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import numpy as np
import pytest
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from common.runtime.node import LoopCallbacks
from people4d.codec import decode, encode
from people4d.messages import Event, Message, PersonSkeleton, RgbdFrame, Skeletons, Tracks
from people4d.topics import BY_MESSAGE
from scripts.dashboard_feed import Feed
from services.dashboard.build import build
from services.dashboard.config import DashboardConfig
from services.dashboard.node import DashboardNode
from services.dashboard.scene import skeletons_of
from services.dashboard.selection import FrameSelection
from services.dashboard.server import PORTS

WAIT_S = 20.0


class RunningNode:
    """A node fed by the test, its page, and its subscriptions."""

    def __init__(self, **settings: Any) -> None:
        self.node: DashboardNode = build(DashboardConfig(port=0, **settings))
        self.demanded: set[str] = set()
        self.published: list[Message] = []
        self._woken = threading.Event()
        self.node.attach(LoopCallbacks(demand=self._demand, robot="robby", wake=self._woken.set))
        assert self.node._server
        self.url = self.node._server.address.url

    def _demand(self, kinds: Any) -> None:
        self.demanded = {kind.__name__ for kind in kinds}

    @contextlib.contextmanager
    def connect(self, **request: Any) -> Iterator[ClientConnection]:
        """Open the stream and send a request."""
        url = self.url.replace("http", "ws") + "stream"
        with connect(url, origin=Origin(self.url.rstrip("/")), max_size=None) as socket:
            if request:
                socket.send(msgspec.msgpack.encode(request))
            yield socket

    def feed(self, *messages: Message) -> None:
        for message in messages:
            payload = encode(message)
            if self.node.admits(BY_MESSAGE[type(message)], payload):
                self.node.handle(decode(payload), time.monotonic_ns())
        self.published += self.node.tick(time.monotonic_ns())

    def wait(self, condition: Callable[[], bool]) -> None:
        """Tick at each change of the demand until a condition is met."""
        while not condition():
            assert self._woken.wait(WAIT_S), self.demanded
            self._woken.clear()
            self.node.tick(time.monotonic_ns())

    def wait_for(self, demanded: str) -> None:
        """Wait until a kind of message is demanded."""
        self.wait(lambda: demanded in self.demanded)


@pytest.fixture
def run() -> Iterator[RunningNode]:
    running = RunningNode()
    yield running
    running.node.close()


def receive(socket: ClientConnection, kind: str) -> dict[str, Any]:
    """Return the next packet of a kind."""
    while True:
        packet: dict[str, Any] = msgspec.msgpack.decode(socket.recv(WAIT_S, decode=False))
        if packet["type"] == kind:
            return packet


def feed_of(people: int = 2) -> Feed:
    return Feed(people, 64)


def test_without_viewers_nothing_but_people_is_decoded(run: RunningNode) -> None:
    feed = feed_of()
    run.feed(feed.info, feed.pose, *feed.frame(0, 10**9))
    assert run.demanded == set()
    assert run.node.status().counters["images"] == 0


def test_viewer_gets_people_boxes_and_the_image_of_the_same_frame(run: RunningNode) -> None:
    feed = feed_of()
    run.feed(feed.info, feed.pose)
    with run.connect() as socket:
        run.wait_for("RgbdFrame")
        run.feed(*feed.frame(3, 10**9))
        scene, image = receive(socket, "scene"), receive(socket, "image")
    assert scene["at_ms"] == image["at_ms"]
    assert {person["id"] for person in scene["people"]} == {1, 2}
    assert {box["id"] for box in scene["boxes"]} == {1, 2}
    assert set(scene["joints"]) == set(scene["arrows"]) == {1, 2}
    assert image["jpeg"].startswith(b"\xff\xd8\xff")
    person = next(one for one in scene["people"] if one["id"] == 1)
    expected = feed.walkers[0].state(1.0)[0]
    np.testing.assert_allclose(person["position_m"][:2], expected, atol=1e-3)


def test_joints_are_lifted_to_their_depth(run: RunningNode) -> None:
    feed = Feed(1, 320)
    run.feed(feed.info, feed.pose)
    with run.connect() as socket:
        run.wait_for("RgbdFrame")
        run.feed(*feed.frame(3, 10**9))
        scene = receive(socket, "scene")
    lifted = np.array(scene["joints"][1], float)
    np.testing.assert_allclose(lifted, feed.walkers[0].joints(1.0), atol=2e-3)


def test_skeletons_of_shown_frames_are_sent_with_what_is_predicted(run: RunningNode) -> None:
    feed = Feed(1, 64)
    run.feed(feed.info, feed.pose)
    person = PersonSkeleton(
        id=1,
        state="confirmed",
        positions_m=feed.walkers[0].joints(1.0).astype(np.float32),
        covariances_m2=np.tile(1e-4 * np.eye(3, dtype=np.float32), (17, 1, 1)),
        measured=(True,) * 15 + (False,) * 2,
        posture="sitting",
        posture_probability=0.9,
    )
    header: dict[str, Any] = {"sequence": 3, "frame_id": "map", "camera": feed.info.camera}
    with run.connect() as socket:
        run.wait_for("Skeletons")
        run.feed(Skeletons(stamp_ns=7, people=(), **header))  # belongs to no shown frame
        run.feed(*feed.frame(3, 10**9), Skeletons(stamp_ns=10**9, people=(person,), **header))
        skeletons = receive(socket, "skeletons")
    assert skeletons["predicted"] == {1: [15, 16]}
    assert skeletons["postures"] == {1: "sitting"}
    figure = msgspec.structs.replace(person, object_like=0.95)
    message = Skeletons(stamp_ns=10**9, people=(figure,), **header)
    assert skeletons_of(message)["postures"] == {1: "object-like"}
    np.testing.assert_allclose(skeletons["joints"][1], person.positions_m, atol=1e-3)


def test_cloud_is_sent_to_those_who_show_it(run: RunningNode) -> None:
    feed = feed_of()
    run.feed(feed.info, feed.pose)
    with run.connect(type="watch", images=True, cloud=True) as socket:
        run.wait_for("RgbdFrame")
        run.wait(lambda: run.node._demand.cloud)
        run.feed(*feed.frame(3, 10**9))
        cloud = receive(socket, "cloud")
    assert len(cloud["depth_mm"]) == 2 * cloud["width"] * cloud["height"]
    assert len(cloud["rgb"]) == 3 * cloud["width"] * cloud["height"]


def test_privacy_lets_no_pixel_out() -> None:
    run = RunningNode(privacy=True)
    try:
        feed = feed_of()
        run.feed(feed.info, feed.pose)
        with run.connect(type="watch", images=True, cloud=True) as socket:
            run.wait_for("Detections")
            assert not run.demanded & {"RgbdFrame", "CompressedRgbdFrame"}
            run.feed(*feed.frame(0, 10**9))
            kinds = set()
            while "scene" not in kinds:
                kinds.add(msgspec.msgpack.decode(socket.recv(WAIT_S, decode=False))["type"])
        assert not kinds & {"image", "cloud"}
        assert run.node.status().counters["images"] == 0
    finally:
        run.node.close()


def test_subscriptions_end_with_the_last_viewer(run: RunningNode) -> None:
    with run.connect():
        run.wait_for("Health")
    run.wait(lambda: not run.demanded)


def test_frames_are_selected_at_a_rate_and_their_messages_belong_together() -> None:
    selection = FrameSelection(rate_hz=1e-3)
    feed = feed_of()
    selection.holds_frames = True
    decoded = []
    for number in range(5):
        for message in feed.frame(number, number * 33_000_000)[:3]:
            payload = encode(message)
            if selection.admits(BY_MESSAGE[type(message)].name, payload):
                decoded.append((type(message).__name__, message.sequence))
    assert decoded == [("Detections", 0), ("Tracks", 0)]
    found = selection.take_frame(("front", 0))
    assert found is not None
    assert isinstance(decode(found), RgbdFrame)
    assert selection.count_tracks() == 5


def test_tracks_that_come_before_their_detections_are_found() -> None:
    selection = FrameSelection(rate_hz=1e6)
    _, first, _, _ = feed_of().frame(0, 0)
    _, detections, tracks, _ = feed_of().frame(1, 33_000_000)
    assert selection.admits("detections", encode(first))
    assert not selection.admits("people", encode(tracks))
    assert selection.admits("detections", encode(detections))
    found = selection.take_tracks(("front", 33_000_000))
    assert found is not None
    assert isinstance(decode(found), Tracks)


@pytest.mark.parametrize("junk", [b"", b"\xc1", b"\x90", b"\x93" * 1000])
def test_bytes_without_a_header_go_to_the_decoder_that_counts_them(junk: bytes) -> None:
    assert FrameSelection(10).admits("people", junk)


def test_image_that_comes_late_is_sent_with_its_people_in_one_packet(run: RunningNode) -> None:
    feed = feed_of()
    run.feed(feed.info, feed.pose)
    with run.connect() as socket:
        run.wait_for("RgbdFrame")
        first, *others = feed.frame(3, 10**9)
        run.feed(*others)
        alone = receive(socket, "scene")
        run.feed(first)
        scene, image = receive(socket, "scene"), receive(socket, "image")
    assert (alone["has_image"], scene["has_image"]) == (False, True)
    assert alone["frame"] == scene["frame"] == image["frame"] == str(10**9)
    assert alone["people"] == scene["people"]


def test_paused_viewer_gets_image_and_cloud_of_the_frame_that_it_seeks(run: RunningNode) -> None:
    feed = feed_of()
    run.feed(feed.info, feed.pose)
    with run.connect(type="watch", images=True, cloud=True) as socket:
        run.wait_for("RgbdFrame")
        run.wait(lambda: run.node._demand.cloud)
        run.feed(*feed.frame(3, 10**9))
        at_ms = receive(socket, "cloud")["at_ms"]
        run.node._selection.rate_hz = 1e9
        for number in range(4, 8):  # sooner than the next cloud is due
            run.feed(*feed.frame(number, number * 10**9))
        socket.send(msgspec.msgpack.encode({"type": "pause"}))
        socket.send(msgspec.msgpack.encode({"type": "seek", "at_ms": at_ms + 1000}))
        shown: dict[str, str] = {}  # newest frame of each kind, as on the page
        while "cloud" not in shown:
            packet = msgspec.msgpack.decode(socket.recv(WAIT_S, decode=False))
            if packet["type"] in ("scene", "image", "cloud"):
                shown[packet["type"]] = packet["frame"]
    assert shown == dict.fromkeys(("scene", "image", "cloud"), str(10**9))


def test_page_that_opens_later_gets_the_events(run: RunningNode) -> None:
    with run.connect() as early:
        receive(early, "about")  # the server runs
        run.feed(*(Event(stamp_ns=n, sequence=n, kind="appeared", id=n + 1) for n in range(3)))
        while len(receive(early, "events")["events"]) < 3:
            pass
        with run.connect() as late:
            events = receive(late, "events")["events"]
    assert [(one["number"], one["kind"], one["id"]) for one in events] == [
        *((0, "appeared", 1), (1, "appeared", 2), (2, "appeared", 3))
    ]


def test_next_free_port_is_taken_if_the_port_is_not_free() -> None:
    first = RunningNode()
    port = int(first.url.rstrip("/").rpartition(":")[2])
    second: DashboardNode = build(DashboardConfig(port=port))
    try:
        second.attach(LoopCallbacks(robot="robby"))
        assert second._server
        other = int(second._server.address.url.rstrip("/").rpartition(":")[2])
        assert port < other < port + PORTS
    finally:
        second.close()
        first.node.close()
