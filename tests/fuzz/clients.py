"""Readers of input from pages, from nodes of ROS 2, and of files of the state folder."""

import contextlib
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
from starlette.websockets import WebSocketDisconnect

from common.ros2 import types
from common.ros2.transport import Ros2Sample
from deploy.cli.data.info import read_info
from people4d.codec import encode
from people4d.errors import DecodeError
from people4d.messages import Event, ZoneEdit
from services.camera.ros.live import LiveRosOptions, LiveRosSource
from services.camera.ros.live_camera import LiveCamera
from services.camera.ros.sample_queue import TopicSample
from services.camera.ros.topics import CAMERA_INFO, JOINTS, ODOMETRY, RGBD, TF, Topics
from services.dashboard.address import Tokens
from services.dashboard.history import History, Packet
from services.dashboard.hub import Hub, Viewer
from services.dashboard.selection import FrameSelection
from services.dashboard.web import PageRequest, WebApp
from services.dashboard.zones import ZonesRequest, zone_edit
from services.events.journal import Journal
from services.events.zones import read_zones, write_zones
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.sources.ros2 import PEOPLE, POSE, Ros2Truth
from services.ros2_bridge.reader_frames import COUNTERS, ReaderFrames
from tests.contract.examples import BY_NAME, FULL, SPARSE, ZONE
from tests.fuzz import messages as network
from tests.fuzz.files import BIG
from tests.fuzz.target import Target

IMAGE = "sensor_msgs/msg/Image"
INFO_TOPICS = ("/colour/camera_info", "/depth/camera_info")
TOPICS = Topics("/colour", "/depth", *INFO_TOPICS, "/odom")
KINDS = {
    "/colour": IMAGE,
    "/depth": IMAGE,
    "/tf": TF,
    "/tf_static": TF,
    "/odom": ODOMETRY,
    "/joints": JOINTS,
    "/rgbd": RGBD,
    **dict.fromkeys(INFO_TOPICS, CAMERA_INFO),
}


class _Page:
    """A socket that sends frames and leaves."""

    def __init__(self, frames: Sequence[bytes]) -> None:
        self._frames = iter(frames)

    async def receive_bytes(self) -> bytes:
        for frame in self._frames:
            return frame
        raise WebSocketDisconnect


def _frames(data: bytes) -> list[bytes]:
    """Divide bytes into frames, each after its length."""
    frames = []
    while data:
        frames.append(data[1 : 1 + data[0]])
        data = data[1 + data[0] :]
    return frames


def _stream(data: bytes, _: Path) -> None:
    history = History(10.0, 2**20)
    for number in range(5):
        history.add_packet(Packet(1000.0 * number, "scene front", (("scene", b"x"),)))
    hub = Hub(history, lambda _: None)
    app = WebApp(hub, Tokens(), frozenset(), lambda _: None)
    viewer = Viewer("operator")
    hub.join(viewer)
    socket: Any = _Page(_frames(data))
    work = app._receive(socket, viewer)
    with contextlib.suppress(StopIteration):
        work.send(None)
        raise AssertionError("it waits for something else than a frame")


def _stream_seeds(_: Path) -> Sequence[bytes]:
    seeks = [PageRequest("seek", at_ms=at_ms) for at_ms in (2500.0, -1e300)]
    others = [PageRequest("watch", cloud=True), PageRequest("pause"), PageRequest("live")]
    requests = [*others[:2], seeks[0], others[2], seeks[1]]
    frames = [msgspec.msgpack.encode(request) for request in requests]
    return [b"".join(bytes([len(f)]) + f for f in frames), b"\x01\xc1"]


def _zones_request(data: bytes, _: Path) -> None:
    try:
        zone_edit(msgspec.json.decode(data, type=ZonesRequest))
    except (msgspec.DecodeError, ValueError):  # as in the page's reply
        return


def _zones_request_seeds(_: Path) -> Sequence[bytes]:
    zone = {"name": " door", "corners_m": ZONE.corners_m.tolist(), "dwell_s": 10.0, "count": 3}
    return [json.dumps({"base": 3, "zones": zones}).encode() for zones in ([], [zone])]


def _zones_file(data: bytes, folder: Path) -> None:
    path = folder / "zones.json"
    path.write_bytes(data)
    revision, zones = read_zones(path)
    write_zones(path, revision, zones)
    again, same = read_zones(path)
    assert (again, encode_zones(same)) == (revision, encode_zones(zones))


def encode_zones(zones: Any) -> bytes:
    """Return the bytes of zones, to compare them."""
    return encode(ZoneEdit(stamp_ns=0, sequence=0, base=0, zones=zones))


def _zones_file_seeds(folder: Path) -> Sequence[bytes]:
    write_zones(folder / "zones.json", 4, (ZONE,))
    return [(folder / "zones.json").read_bytes()]


def _journal(data: bytes, folder: Path) -> None:
    path = folder / "events.sqlite"
    for old in folder.glob("events.sqlite*"):
        old.unlink()
    path.write_bytes(data)
    journal = Journal(path, 100)
    try:
        journal.last_number()
        journal.after(-1)
        journal.mark("published")
    finally:
        journal.close()


def _journal_seeds(folder: Path) -> Sequence[bytes]:
    journal = Journal(folder / "events.sqlite", 100)
    journal.append([m for m in (*FULL, *SPARSE) if isinstance(m, Event)][:1])
    journal.set_mark("published", 0)
    journal.close()
    return [(folder / "events.sqlite").read_bytes()]


def _selection(data: bytes, _: Path) -> None:
    selection = FrameSelection(30.0)
    selection.holds_frames = True
    for name in ("detections", "people", "frames", "compressed"):
        selection.admits(name, data)
    selection.take_frame(("front", 0))
    selection.take_tracks(("front", 0))


def _live(data: bytes, _: Path) -> None:
    """Deliver messages to a camera of live topics: topic, length, bytes."""
    source = LiveRosSource(
        "ros2:/colour,/depth", LiveRosOptions(colour_topic="/colour", depth_topic="/depth")
    )
    camera = LiveCamera(TOPICS, LiveRosOptions(), source.counters)
    for topic, cdr in _samples(data, list(KINDS)):
        kind = KINDS[topic]
        for item in source._items(TopicSample(topic, cdr, 10**9), kind, TOPICS, camera):
            if isinstance(item, msgspec.Struct):
                encode(item)


def _samples(data: bytes, topics: Sequence[str]) -> list[tuple[str, bytes]]:
    samples = []
    while len(data) > 3:
        size = int.from_bytes(data[1:3], "little")
        samples.append((topics[data[0] % len(topics)], data[3 : 3 + size]))
        data = data[3 + size :]
    return samples


def _packed(samples: Sequence[tuple[int, bytes]]) -> bytes:
    return b"".join(bytes([n]) + len(cdr).to_bytes(2, "little") + cdr for n, cdr in samples)


def _live_seeds(folder: Path) -> Sequence[bytes]:
    readers = list(network.READERS)
    cdr: dict[str, list[bytes]] = {}
    for seed in network._ros_seeds(folder):
        cdr.setdefault(readers[seed[0]], []).append(seed[1:])
    samples = [
        (index, one) for index, kind in enumerate(KINDS.values()) for one in cdr.get(kind, ())[:2]
    ]
    order = sorted(samples, key=lambda sample: KINDS[list(KINDS)[sample[0]]] == IMAGE)
    return [_packed(order), _packed(samples[:3])]


def _ros_truth(data: bytes, _: Path) -> None:
    """Deliver truth and transforms of ROS 2."""
    truth = Ros2Truth(GtBridgeConfig(truth="ros2:/people,/anna/pose"))
    frames = ReaderFrames(Counter(dict.fromkeys(COUNTERS, 0)), lambda: None)
    for topic, cdr in _samples(data, ("/people", "/anna/pose", "/tf", "/tf_static")):
        with contextlib.suppress(DecodeError):
            if topic == "/people":
                truth._people(topic, Ros2Sample(cdr, 0))
            elif topic.endswith("pose"):
                truth._pose(topic, Ros2Sample(cdr, 0))
            else:
                frames.add_payload(Ros2Sample(cdr, 0), static=topic == "/tf_static")
    for one in truth.take_truth():
        encode(one)
    frames.newest_ns("map", "base")


def _ros_truth_seeds(_: Path) -> Sequence[bytes]:
    stamp = {"sec": 5, "nanosec": 7}
    header = {"stamp": stamp, "frame_id": "map"}
    pose = {"position": {"x": 1.0, "y": 2.0}, "orientation": {"w": 1.0}}
    person = {"name": "anna", "position": {"x": 1.0}, "tagnames": ["yaw_rad"], "tags": ["0.5"]}
    edge = {"header": header, "child_frame_id": "base", "transform": {"rotation": {"w": 1.0}}}
    sent = [
        types.encode(PEOPLE, {"header": header, "people": [person]}),
        types.encode(POSE, {"header": header, "pose": pose}),
        types.encode(TF, {"transforms": [edge]}),
        types.encode(TF, {"transforms": [edge | {"child_frame_id": "map"}]}),
    ]
    return [_packed(list(enumerate(sent))), _packed([(1, sent[1]), (1, sent[1])])]


def _info(data: bytes, folder: Path) -> None:
    (folder / "a.mcap").write_bytes(data)
    read_info(folder / "a.mcap")


def _info_seeds(folder: Path) -> Sequence[bytes]:
    from tests.camera.test_sources import recorded  # noqa: PLC0415

    return [recorded(folder / "a.mcap").read_bytes()]


TARGETS = (
    Target("requests of a page", _stream, _stream_seeds, (b"\xa4type", b"\xa5at_ms", b"\xc3")),
    Target("zones of a page", _zones_request, _zones_request_seeds, (b"1e999", b"corners_m")),
    Target("file of zones", _zones_file, _zones_file_seeds, (b"1e999", b"corners_m", b"null")),
    Target("journal of events", _journal, _journal_seeds, max_bytes=BIG),
    Target(
        "selection of frames",
        _selection,
        lambda _: [encode(BY_NAME[name]) for name in ("Detections", "Tracks", "RgbdFrame")],
        (b"\xa6camera", b"\xa8stamp_ns"),
    ),
    Target("live topics of a camera", _live, _live_seeds, (b"rgb8", b"16UC1"), max_bytes=16384),
    Target("live truth and transforms", _ros_truth, _ros_truth_seeds, (b"map", b"base", b"nan")),
    Target("description of a recording", _info, _info_seeds, max_bytes=BIG),
)
