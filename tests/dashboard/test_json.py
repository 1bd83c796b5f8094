"""People as JSON for programs, by the page's server."""

import json
import shutil
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from common.io.plain_json import to_json
from tests.contract.examples import BY_NAME
from tests.dashboard.test_node import WAIT_S, RunningNode, feed_of
from tests.docs.pages import blocks

SECOND_NS = 10**9


@pytest.fixture
def serving() -> Iterator[RunningNode]:
    running = RunningNode(people_json=True)
    yield running
    running.node.close()


def join(node: RunningNode, **headers: str) -> ClientConnection:
    """Join as a program, with the page as its origin."""
    url = node.url.replace("http", "ws") + "people"
    return connect(url, origin=Origin(node.url.rstrip("/")), additional_headers=headers)


def reason_of_end(socket: ClientConnection) -> str:
    with pytest.raises(ConnectionClosed) as closed:
        socket.recv(WAIT_S)
    assert closed.value.rcvd
    return closed.value.rcvd.reason


def test_program_gets_people_of_a_frame_and_no_images(serving: RunningNode) -> None:
    feed = feed_of()
    serving.feed(feed.info, feed.pose)
    with join(serving) as socket:
        serving.wait_for("Detections")
        assert "RgbdFrame" not in serving.demanded
        serving.feed(*feed.frame(3, SECOND_NS))
        message = json.loads(socket.recv(WAIT_S))
    assert (message["robot"], message["camera"]) == ("robby", feed.info.camera)
    found = {track["id"]: track for track in message["tracks"]}
    assert found.keys() == {1, 2}
    expected = feed.walkers[0].state(1.0)[0]
    np.testing.assert_allclose(found[1]["position_m"][:2], expected, atol=1e-9)


def test_page_gets_no_json(serving: RunningNode) -> None:
    feed = feed_of()
    serving.feed(feed.info, feed.pose)
    with join(serving) as program, serving.connect() as page:
        serving.wait_for("RgbdFrame")
        serving.feed(*feed.frame(3, SECOND_NS))
        assert program.recv(WAIT_S)
        serving.feed(*feed.frame(9, 2 * SECOND_NS))
        received = [page.recv(WAIT_S) for _ in range(5)]
    assert all(isinstance(packet, bytes) and packet[:1] != b"{" for packet in received)


def test_program_is_refused_with_a_remedy_unless_the_setting_is_on() -> None:
    running = RunningNode()
    try:
        with join(running) as socket:
            assert "set dashboard.people_json = true" in reason_of_end(socket)
    finally:
        running.node.close()


def test_message_of_a_program_ends_its_connection(serving: RunningNode) -> None:
    with join(serving) as socket:
        socket.send("hello")
        assert reason_of_end(socket) == "no valid request"


def test_json_has_all_fields_of_a_message_but_the_trace() -> None:
    tracks = BY_NAME["Tracks"]
    plain = json.loads(to_json(tracks, "robby"))
    assert plain.keys() == {"robot", *tracks.__struct_fields__} - {"trace"}
    (track,) = plain["tracks"]
    assert track["position_m"] == [1.0, 2.0, 3.0]
    assert np.shape(track["covariance"]) == (6, 6)


def test_program_of_the_documentation_receives_in_node(
    serving: RunningNode, tmp_path: Path
) -> None:
    node = shutil.which("node")
    if not node:
        pytest.skip("node is not installed")
    (block,) = (block for block in blocks("javascript") if block.page.name == "json.md")
    address = serving.url.removeprefix("http://").rstrip("/")
    file = tmp_path / "people.mjs"
    file.write_text(block.code.replace("127.0.0.1:7480", address))
    feed = feed_of()
    serving.feed(feed.info, feed.pose)
    command = [node, "--experimental-websocket", str(file)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        timer = threading.Timer(WAIT_S, process.kill)
        timer.start()
        try:
            serving.wait_for("Detections")
            serving.feed(*feed.frame(3, SECOND_NS))
            assert process.stdout
            lines = [process.stdout.readline() for _ in range(2)]
        finally:
            timer.cancel()
            process.kill()
    found = {int(line.split()[0]): line.split() for line in lines}
    assert found.keys() == {1, 2}
    expected = feed.walkers[0].state(1.0)[0]
    assert [float(value) for value in found[1][1:3]] == pytest.approx(expected)
