"""Foxglove: files and server, read by the mcap library, protobuf and a plain WebSocket client."""

import asyncio
import base64
import json
import re
import signal
import struct
import subprocess
import sys
import threading
from collections import Counter
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader
from typer.testing import CliRunner
from websockets.asyncio.client import connect
from websockets.typing import Subprotocol

from common.io.images import compress, decode_image
from common.transport.ports import free_port
from deploy.cli import app
from deploy.viewers.foxglove_messages import FoxgloveConverter
from deploy.viewers.foxglove_outputs import FoxgloveFile, FoxgloveServer
from people4d.errors import ConfigError, SourceError
from people4d.messages import RgbdFrame
from tests import ROOT
from tests.deploy.viewers import protobuf, walk
from tests.network import WAIT_S, Network

SCHEMAS = {
    "/front/calibration": "foxglove.CameraCalibration",
    "/tf_static": "foxglove.FrameTransforms",
    "/tf": "foxglove.FrameTransforms",
    "/front/image": "foxglove.CompressedImage",
    "/front/depth": "foxglove.RawImage",
    "/front/annotations": "foxglove.ImageAnnotations",
    "/people": "foxglove.SceneUpdate",
    "/skeletons": "foxglove.SceneUpdate",
    "/predictions": "foxglove.SceneUpdate",
    "/latency": "people4d.Latency",
    "/health": "people4d.Health",
}


def read(path: Path) -> dict[str, list[Any]]:
    """Read the messages of an MCAP file by topic, with checksums."""
    found: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            value = None
            if schema and channel.message_encoding == "protobuf":
                value = protobuf.decode(schema.name, schema.data, message.data)
            elif schema and channel.message_encoding == "json":
                value = json.loads(message.data)
            found.setdefault(channel.topic, []).append(value)
    return found


def schemas(path: Path) -> dict[str, str]:
    with path.open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
    assert summary is not None
    assert summary.chunk_indexes
    return {
        channel.topic: summary.schemas[channel.schema_id].name
        for channel in summary.channels.values()
        if channel.schema_id
    }


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return walk.record(tmp_path / "walk.mcap")


def test_file_holds_what_the_app_shows(recording: Path, tmp_path: Path) -> None:
    file = tmp_path / "out.mcap"
    result = CliRunner().invoke(app, ["view", str(recording), "--foxglove", str(file)])
    assert result.exit_code == 0, result.output
    assert schemas(file) == SCHEMAS
    content = read(file)
    assert {topic: len(content[topic]) for topic in ("/people", "/front/image")} == {
        "/people": walk.FRAMES,
        "/front/image": walk.FRAMES,
    }
    depth = content["/front/depth"][-1]
    values = np.frombuffer(depth.data, "<u2").reshape(depth.height, depth.width)
    assert depth.encoding == "16UC1"
    assert (values == walk.DEPTH_MM + 4).all()  # lossless
    assert decode_image(content["/front/image"][0].data, cv2.IMREAD_COLOR).shape == (120, 160, 3)
    person = content["/people"][-1].entities[0]
    assert (person.id, person.frame_id) == ("track 7", "map")
    assert [p.y for p in person.lines[0].points] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    skeleton = content["/skeletons"][-1].entities[0]
    assert skeleton.frame_id == "map"
    assert [s.pose.position.x for s in skeleton.spheres] == pytest.approx([2.004] * 16)
    (text,) = content["/front/annotations"][-1].texts
    assert text.text.startswith("#7 ")
    assert content["/latency"][-1]["end_to_end_ms"] == pytest.approx(30.0)
    static = content["/tf_static"][-1].transforms[0]
    assert (static.parent_frame_id, static.child_frame_id) == ("map", "front_optical_frame")
    assert static.translation.z == pytest.approx(1.2)
    prediction = content["/predictions"][-1].entities[0]
    assert [p.y for p in prediction.lines[0].points] == pytest.approx([0.4, 1.0, 2.0])


def test_file_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(SourceError, match="cannot be written"):
        FoxgloveFile(FoxgloveConverter(images=False), tmp_path / "file" / "out.mcap")
    with pytest.raises(SourceError, match="cannot be written"):
        FoxgloveFile(FoxgloveConverter(images=False), tmp_path)


async def receive(
    port: int, topic: str, server: FoxgloveServer | None = None
) -> tuple[dict[str, Any], bytes]:
    """Subscribe to a topic as any client of the protocol does; return channel and message."""
    uri = f"ws://127.0.0.1:{port}"
    async with connect(uri, subprotocols=[Subprotocol("foxglove.sdk.v1")]) as client:
        assert client.subprotocol == "foxglove.sdk.v1"
        channel = None
        while channel is None:
            text = await client.recv()
            parsed = json.loads(text) if isinstance(text, str) else {}
            for one in parsed.get("channels", []):
                channel = one if one["topic"] == topic else channel
        subscription = {"id": 1, "channelId": channel["id"]}
        subscribe = json.dumps({"op": "subscribe", "subscriptions": [subscription]})
        await client.send(subscribe)
        while True:
            if server:
                for log_time_ns, message in walk.messages():
                    server.write(message, log_time_ns)
            try:
                data = await asyncio.wait_for(client.recv(), 0.2)
            except TimeoutError:
                continue
            if isinstance(data, bytes) and data[0] == 1:
                return channel, data
            if isinstance(data, str) and "Unknown channel" in data:
                await client.send(subscribe)  # the SDK advertises a channel before it knows it


@pytest.mark.network
def test_a_plain_websocket_client_receives_the_people() -> None:
    server = FoxgloveServer(FoxgloveConverter(images=True), "127.0.0.1", 0)
    try:
        for log_time_ns, message in walk.messages():
            server.write(message, log_time_ns)
        channel, data = asyncio.run(
            asyncio.wait_for(receive(server.port, "/people", server), WAIT_S)
        )
        _, subscription, _ = struct.unpack_from("<BIQ", data)
        assert subscription == 1
        assert channel["schemaName"] == "foxglove.SceneUpdate"
        schema = base64.b64decode(channel["schema"])
        update = protobuf.decode("foxglove.SceneUpdate", schema, data[13:])
        assert update.entities[0].id == "track 7"
        with pytest.raises(ConfigError, match="Address already in use"):
            FoxgloveServer(FoxgloveConverter(images=False), "127.0.0.1", server.port)
    finally:
        server.close()


@pytest.mark.network
def test_live_view_serves_what_a_running_system_publishes(network: Network) -> None:
    robot, port = network.robot(), free_port()
    bus, stopped = network.open(robot), threading.Event()
    command = [sys.executable, "-m", "deploy.cli", "view", "--foxglove", "--port", str(port)]
    command += ["--robot", robot, "--connect", network.endpoint]

    def publish() -> None:
        while not stopped.is_set():
            for _, message in walk.messages():  # at a rate that a slow machine draws
                bus.publish(message)
                stopped.wait(0.05)

    thread = threading.Thread(target=publish)
    thread.start()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout
            assert f"ws://127.0.0.1:{port}" in process.stdout.readline()
            entities: list[Any] = []
            while not entities:  # a message may arrive before its frame
                channel, data = asyncio.run(asyncio.wait_for(receive(port, "/skeletons"), WAIT_S))
                schema = base64.b64decode(channel["schema"])
                update = protobuf.decode("foxglove.SceneUpdate", schema, data[13:])
                entities = list(update.entities)
            assert len(entities[0].spheres) == 16
        finally:
            stopped.set()
            thread.join()
            process.send_signal(signal.SIGTERM)
            assert process.wait(WAIT_S) == 0


def test_without_images_no_pixel_is_converted() -> None:
    converter = FoxgloveConverter(images=False)
    topics = Counter(topic for t, m in walk.messages() for topic, _ in converter.convert(m, t))
    assert not {"/front/image", "/front/depth"} & topics.keys()
    assert topics["/people"] == walk.FRAMES


def test_predicted_joints_are_pale() -> None:
    content: Any = dict(FoxgloveConverter(images=False).convert(walk.skeletons(), 0))["/skeletons"]
    schema = content.get_schema()
    update = protobuf.decode(schema.name, schema.data, content.encode())
    opacities = [sphere.color.a for sphere in update.entities[0].spheres]
    assert opacities[0] < 0.5
    assert opacities[1:] == [1.0] * 16
    assert sorted({round(line.color.a, 2) for line in update.entities[0].lines}) == [0.35, 1.0]


def test_corrupt_image_is_counted() -> None:
    converter = FoxgloveConverter(images=True)
    recorded = [m for _, m in walk.messages()]
    frame = next(m for m in recorded if isinstance(m, RgbdFrame))
    intact = compress(frame)
    cut = msgspec.structs.replace(intact, depth_png=intact.depth_png[:200])
    assert [i for m in recorded[:1] for i in converter.convert(m, 0)]
    assert list(converter.convert(cut, 1)) == []
    assert converter.bad_images == 1


def test_layout_arranges_its_panels_with_topics_of_the_converter() -> None:
    text = (ROOT / "deploy/viewers/people4d_layout.json").read_text()
    layout = json.loads(text)
    assert set(layout["configById"]) == set(leaves(layout["layout"]))
    topics = set(re.findall(r'"(/[a-z_/]+)[".]', text))
    assert topics <= SCHEMAS.keys()


def leaves(node: Any) -> list[str]:
    return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]
