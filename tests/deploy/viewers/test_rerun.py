"""Rerun: its own reader reads back what was written."""

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
import rerun as rr
from rerun.chunk import RrdReader
from typer.testing import CliRunner

from common.io.recording import RecordingWriter
from common.transport.ports import free_port
from deploy.cli import app
from deploy.cli.live.view import ImageRate
from deploy.viewers.rerun_log import VIEWS_MAX, RerunLog, open_log
from people4d.errors import SourceError
from tests import builders
from tests.deploy.viewers import walk


def test_file_is_read_back_by_its_own_reader(tmp_path: Path) -> None:
    recording, file = walk.record(tmp_path / "walk.mcap"), tmp_path / "out.rrd"
    result = CliRunner().invoke(app, ["view", str(recording), "--rerun", str(file)])
    assert result.exit_code == 0, result.output
    reader = RrdReader(file)
    assert len(reader.recordings()) == 1
    assert reader.blueprints()  # the arrangement is in the file
    rows: Counter[str] = Counter()
    last: dict[str, Any] = {}
    for chunk in reader.stream().to_chunks():
        batch = chunk.to_record_batch()
        rows[chunk.entity_path] += batch.num_rows
        for name in batch.schema.names:
            if ":" not in name:  # a timeline
                continue
            last[f"{chunk.entity_path} {name}"] = batch.column(name)[-1].as_py()
    every_frame = (
        *("/map/front/image", "/map/front/depth", "/map/front/boxes", "/map/front/limbs"),
        *("/map/people", "/map/uncertainty", "/map/headings", "/map/trajectories"),
        *("/map/skeletons", "/map/predictions", "/map/front", "/odom/base_link"),
        *("/latency/end_to_end", "/latency/tracker/work", "/health"),
    )
    assert dict.fromkeys(every_frame, walk.FRAMES).items() <= dict(rows).items() | {
        ("/map/front", walk.FRAMES)
    }
    assert last["/latency/end_to_end Scalars:scalars"] == pytest.approx([30.0])
    assert last["/map/people Points3D:positions"][0] == pytest.approx([2.0, 0.4, 1.2])
    assert len(last["/map/skeletons LineStrips3D:strips"]) > 5
    assert bytes(last["/map/front/image EncodedImage:blob"][0][:2]) == b"\xff\xd8"


def test_invented_cameras_do_not_use_up_threads(tmp_path: Path) -> None:
    log = open_log("robot", tmp_path / "out.rrd")
    before = len(os.listdir("/proc/self/task"))
    for number in range(VIEWS_MAX + 40):
        log.write(builders.camera_info(camera=f"c{number}"), number)
    log.close()
    assert len(os.listdir("/proc/self/task")) <= before + 2 * VIEWS_MAX + 10


def test_ended_viewer_is_an_error_and_does_not_hold_the_command() -> None:
    stream, viewer = rr.RecordingStream("people4d"), subprocess.Popen([sys.executable, "-c", ""])
    stream.connect_grpc(f"rerun+http://127.0.0.1:{free_port()}/proxy")
    log = RerunLog(stream, viewer)
    viewer.wait(30.0)
    with pytest.raises(SourceError, match="viewer ended"):
        log.write(builders.camera_info(), 0)
    closing = Thread(target=log.close, daemon=True)
    closing.start()
    closing.join(30.0)
    assert not closing.is_alive()


def test_viewer_has_to_be_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    recording = walk.record(tmp_path / "walk.mcap")
    for options, words in (
        ([], "expected one viewer"),
        (["--rerun", "--foxglove"], "expected one viewer"),
        (["--rerun", "out.mcap"], "out.mcap has an unsupported format"),
        (["--foxglove", "out.rrd"], "out.rrd has an unsupported format"),
        (["--rerun", "out.rrd", "--start", "99"], "--start 99 lies after the end"),
    ):
        result = CliRunner().invoke(app, ["view", str(recording), *options])
        assert words in result.stderr, options
    assert [path.name for path in tmp_path.iterdir()] == ["walk.mcap"]


def test_live_images_are_limited_and_come_once() -> None:
    limit = ImageRate(10.0)
    frames = [m for _, m in walk.messages() if type(m).__name__ == "RgbdFrame"]
    passed = [limit.passes(frames[0], k * 33_000_000 + 10**9) for k in range(30)]
    assert sum(passed) in (8, 9, 10)
    assert limit.passes(builders.tracks(), 0)


def test_skeletons_of_their_own_topic_are_drawn(tmp_path: Path) -> None:
    recording, file = tmp_path / "skeletons.mcap", tmp_path / "out.rrd"
    with RecordingWriter(recording) as writer:
        for log_time_ns, message in walk.messages():
            writer.write(message, log_time_ns)
            if type(message).__name__ == "Tracks":
                writer.write(walk.skeletons(message.stamp_ns), log_time_ns)
    result = CliRunner().invoke(app, ["view", str(recording), "--rerun", str(file)])
    assert result.exit_code == 0, result.output
    lines, colours = [], []
    for chunk in RrdReader(file).stream().to_chunks():
        if chunk.entity_path == "/map/skeletons":
            batch = chunk.to_record_batch()
            lines += batch.column("LineStrips3D:strips").to_pylist()
            colours += batch.column("LineStrips3D:colors").to_pylist()
    assert len(lines) == walk.FRAMES + 1  # the first tracks arrived before the first skeletons
    assert {tuple(point) for line in lines[-1] for point in line} == {(2.0, 0.0, 1.0)}
    assert len({colour & 0xFF for colour in colours[-1]}) == 2  # opacities
