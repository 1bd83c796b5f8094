"""The complete report, from messages to files."""

import json
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from common.runtime.inbox import Inbox
from common.runtime.synchroniser import Synchroniser
from people4d.codec import encode
from people4d.errors import ConfigError, People4dError
from people4d.messages import U8, Message
from people4d.topics import BY_NAME
from services.report.config import ReportConfig
from services.report.folder import AnnotatedFrame, ReportFolder, VideoFile, frame_rate_hz
from services.report.node import ReportNode
from services.report.page import RunPage
from services.report.statistics import RunSummary
from tests.report.builders import (
    MS,
    detection,
    detections,
    frame,
    health,
    info,
    pose,
    track,
    tracks,
    truth,
)

STEP = 100 * MS


class StoredOutput:
    """Output of the report in memory."""

    def __init__(self) -> None:
        self.annotated: list[AnnotatedFrame] = []
        self.sheets: list[U8] = []
        self.summaries: list[RunSummary] = []

    def add_frame(self, frame: AnnotatedFrame) -> None:
        self.annotated.append(frame)

    def finish(self, sheet: U8, page: RunPage) -> None:
        self.sheets.append(sheet)
        self.summaries.append(page.summary)


def run(node: ReportNode, *messages: Message) -> None:
    for k, message in enumerate(messages):
        assert node.handle(message, k * MS) == ()
    node.close()


def stream(count: int, camera: str = "front") -> list[Message]:
    """Frames with one person each, in the order of the pipeline."""
    messages: list[Message] = [info(camera), pose()]
    for k in range(count):
        found = detections(k * STEP, [detection()], camera)
        walked = tracks(k * STEP, [track(1, 2.0 + 0.1 * k, detection_index=0)], camera)
        messages += [frame(k * STEP, camera), found, truth(k * STEP, ("a", 2.0, 0.0)), walked]
    return messages


def test_every_frame_is_annotated_in_order() -> None:
    stored = StoredOutput()
    run(ReportNode(ReportConfig(), stored), *stream(20))
    assert [p.stamp_ns for p in stored.annotated] == [k * STEP for k in range(20)]
    (summary,) = stored.summaries
    assert (summary.frames, summary.frames_detected, summary.frames_tracked) == (20, 20, 20)
    assert summary.score is not None
    assert summary.score.matched == 11  # 2.0 to 3.0 m are within 1 m of the truth at 2.0 m
    assert stored.sheets[0].shape[1] == 4 * 488 + 8


@pytest.mark.parametrize("seed", range(5))
def test_the_order_within_a_stamp_changes_nothing(seed: int) -> None:
    stored = StoredOutput()
    messages = stream(10)
    calibration, rest = messages[:2], messages[2:]
    order = np.random.default_rng(seed)
    shuffled = [m for k in range(10) for m in order.permutation(np.array(rest[4 * k : 4 * k + 4]))]
    run(ReportNode(ReportConfig(), stored), *calibration, *shuffled)
    assert [p.stamp_ns for p in stored.annotated] == [k * STEP for k in range(10)]
    assert stored.summaries[0].frames_tracked == 10


@pytest.mark.parametrize("missing", range(9))
def test_a_missing_stream_is_listed_and_breaks_nothing(missing: int) -> None:
    kinds = ReportNode.inputs
    stored = StoredOutput()
    messages = [m for m in [*stream(8), health(errors=1)] if type(m) is not kinds[missing]]
    run(ReportNode(ReportConfig(), stored), *messages)
    tracked = stored.summaries[0].missing
    name = kinds[missing].__name__
    assert tracked == (
        (name,) if name in ("RgbdFrame", "Detections", "Tracks", "Truth", "Health") else ()
    )


def test_nothing_at_all_still_gives_a_sheet() -> None:
    stored = StoredOutput()
    run(ReportNode(ReportConfig(), stored))
    assert stored.sheets[0].size > 0


def test_two_cameras_have_videos_of_their_own() -> None:
    stored = StoredOutput()
    mixed = [m for pair in zip(stream(5), stream(5, "rear"), strict=True) for m in pair]
    run(ReportNode(ReportConfig(), stored), *mixed)
    assert stored.summaries[0].cameras == ("front", "rear")
    assert stored.summaries[0].frames_tracked == 10
    assert [p.stamp_ns // STEP for p in stored.annotated if p.camera == "rear"] == list(range(5))


def test_without_video_only_the_sheet_is_drawn() -> None:
    stored = StoredOutput()
    run(ReportNode(ReportConfig(video=False, sheet_frames=2), stored), *stream(30))
    assert stored.annotated == []
    assert stored.sheets[0].shape[0] == 60 + 600 + 8 + 368  # one row of tiles 480x360


def test_a_full_synchroniser_releases_the_oldest() -> None:
    join = Synchroniser(capacity=3)
    released = [m for k in range(10) for m in join.add_message(frame(k))]
    assert [m.stamp_ns for m in released] == [0, 1, 2, 3, 4, 5, 6]
    assert [m.stamp_ns for m in join.flush()] == [7, 8, 9]


def test_a_complete_frame_releases_the_older_ones() -> None:
    join = Synchroniser()
    for message in (frame(1), frame(2), detections(2), frame(2, "rear")):
        assert join.add_message(message) == []
    released = join.add_message(tracks(2))
    assert [(m.stamp_ns, m.parts() is not None) for m in released] == [(1, False), (2, True)]
    assert [m.camera for m in join.flush()] == ["rear"]


def test_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    node = ReportNode(ReportConfig(), ReportFolder(ReportConfig(folder=str(tmp_path / "out"))))
    run(node, *stream(25))
    out = tmp_path / "out"
    assert sorted(p.name for p in out.iterdir()) == [
        "contact_sheet.png",
        "people_front.webm",
        "report.html",
        "summary.json",
        "summary.txt",
    ]
    video = cv2.VideoCapture(str(out / "people_front.webm"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 25
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(10.0)
    assert json.loads((out / "summary.json").read_text())["frames_tracked"] == 25
    assert capsys.readouterr().out == (out / "summary.txt").read_text()
    assert cv2.imread(str(out / "contact_sheet.png")) is not None


def test_a_run_of_few_frames_gives_a_video(tmp_path: Path) -> None:
    run(ReportNode(ReportConfig(), ReportFolder(ReportConfig(folder=str(tmp_path)))), *stream(3))
    video = cv2.VideoCapture(str(tmp_path / "people_front.webm"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 3


def annotated(stamp_ns: int) -> AnnotatedFrame:
    return AnnotatedFrame("front", stamp_ns, np.full((48, 64, 3), 128, np.uint8))


def count_frames(video: Path) -> int:
    return int(cv2.VideoCapture(str(video)).get(cv2.CAP_PROP_FRAME_COUNT))


def test_video_is_encoded_after_the_run_from_a_file_without_a_name(tmp_path: Path) -> None:
    video = VideoFile(tmp_path / "people_front.webm")
    for k in range(20):
        video.add_frame(annotated(k * STEP), has_room=True)
    assert video.waiting_bytes > 0
    assert list(tmp_path.iterdir()) == []
    video.encode(time.monotonic() + 60)
    assert [file.name for file in tmp_path.iterdir()] == ["people_front.webm"]
    assert count_frames(video.path) == 20
    assert video.limit == ""


def test_frames_without_room_or_time_are_left_out_of_the_video_and_reported(tmp_path: Path) -> None:
    video = VideoFile(tmp_path / "people_front.webm")
    for k in range(8):
        video.add_frame(annotated(k * STEP), has_room=k < 5)
    video.encode(time.monotonic() + 60)
    assert count_frames(video.path) == 5
    assert video.limit == "report: people_front.webm lacks 3 of 8 frames"
    late = VideoFile(tmp_path / "people_rear.webm")
    for k in range(8):
        late.add_frame(annotated(k * STEP), has_room=True)
    late.encode(time.monotonic() - 1)
    assert count_frames(late.path) == 1
    assert late.limit == "report: people_rear.webm lacks 7 of 8 frames"


def test_incomplete_video_is_a_limit_of_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.report.folder.WAITING_MAX", 0)
    run(ReportNode(ReportConfig(), ReportFolder(ReportConfig(folder=str(tmp_path)))), *stream(3))
    degraded = json.loads((tmp_path / "summary.json").read_text())["degraded"]
    assert degraded == ["report: people_front.webm lacks 3 of 3 frames"]
    assert f"degraded   {degraded[0]}" in (tmp_path / "summary.txt").read_text()


def test_frames_wait_for_a_busy_report() -> None:
    inbox = Inbox(frames_waiting=ReportNode(ReportConfig(), StoredOutput()).frames_waiting)
    for k in range(10):
        inbox.add_payload(BY_NAME["frames"], "front", encode(frame(k * STEP)))
    assert inbox.counters["received_frames"] == 10
    assert inbox.counters["dropped_frames"] == 0


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="cannot be written"):
        ReportFolder(ReportConfig(folder=str(tmp_path / "file")))


def test_frame_rate() -> None:
    assert frame_rate_hz([0, STEP, 2 * STEP, 9 * STEP]) == pytest.approx(10.0)  # median 0.1 s
    assert frame_rate_hz([5]) == 30.0
    assert frame_rate_hz([5, 5]) == 30.0
    assert frame_rate_hz([0, 1]) == 120.0


@pytest.mark.parametrize("setting", [{"sheet_frames": 0}, {"sheet_frames": 101}])
def test_settings_out_of_range(setting: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="expected"):
        ReportConfig(**setting)


def test_a_full_disk_gives_one_sentence_and_no_summary(tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text("{}")  # of the run before
    node = ReportNode(ReportConfig(video=False), ReportFolder(ReportConfig(folder=str(tmp_path))))
    (tmp_path / "summary.txt").unlink()
    (tmp_path / "summary.txt").symlink_to("/dev/full")
    with pytest.raises(People4dError, match=r"cannot be written to .*: No space left on device"):
        run(node, *stream(3))
    assert not (tmp_path / "summary.json").exists()
