"""Files of annotations: truth, agreement of annotators, wrong files."""

import json
from collections.abc import Mapping
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from deploy.cli import app
from evaluation.annotations.agreement import agreement
from evaluation.annotations.images import read_images
from evaluation.annotations.marks import Mark, MarkedImage, read_annotations, write_marks
from evaluation.annotations.truth import annotated_truth
from evaluation.annotations.web import AnnotationApp
from people4d.errors import SourceError
from people4d.messages import StaticTransform
from services.camera.config import CameraConfig
from services.camera.source import SourceFrame
from services.camera.sources import open_source
from services.dashboard.config import DashboardConfig
from services.dashboard.server import WebServer
from services.detector.position.axis import BODY
from tests import DEMO, ROOT, builders

FRAMES, DEPTH_MM, FOCAL_PX = 4, 2000, 100.0
HOLE_PX = 20  # columns without depth at the left edge


def folder(path: Path, colour: int = 50) -> CameraConfig:
    """Write a recording of a wall 2 m away, in a folder, and return its camera."""
    for kind in ("rgb", "depth"):
        (path / kind).mkdir(parents=True)
    for frame in range(FRAMES):
        rgb = np.full((120, 160, 3), colour + frame, np.uint8)
        depth_mm = np.full((120, 160), DEPTH_MM, np.uint16)
        depth_mm[:, :HOLE_PX] = 0
        cv2.imwrite(str(path / "rgb" / f"{frame}.png"), rgb)
        cv2.imwrite(str(path / "depth" / f"{frame}.png"), depth_mm)
    (path / "camera.toml").write_text("[colour]\nfx=100.0\nfy=100.0\ncx=80.0\ncy=60.0\n")
    return CameraConfig(source=str(path), options={"fps": 10.0})


def write(path: Path, camera: CameraConfig, frames: Mapping[int, tuple[Mark, ...]]) -> Path:
    digest = read_images(camera, 1, lambda _: None).digest
    for frame, marks in frames.items():
        write_marks(path, MarkedImage(frame, marks), digest)
    return path


def pose(camera: CameraConfig) -> list[StaticTransform]:
    """Return the transform of a camera at the origin that looks along +x."""
    child = open_source(camera.source, camera.options).info.frame_id
    return [builders.static_transform(camera.mount_from_optical, parent="map", child=child)]


def stamps_ns(camera: CameraConfig) -> list[int]:
    source = open_source(camera.source, camera.options)
    return [item.stamp_ns for item in source if isinstance(item, SourceFrame)]


def test_truth_is_the_axis_behind_the_mark_at_annotated_frames_only(tmp_path: Path) -> None:
    """In the middle of the image, facing the camera: 2 m and half the depth of a body ahead."""
    camera = folder(tmp_path / "wall")
    marks = {0: (Mark("a", 80, 60, 180), Mark("b", 130, 60, None, "mostly")), 2: ()}
    file = write(tmp_path / "marks.json", camera, marks)
    truth = annotated_truth(file, camera, pose(camera), stamps_ns(camera), "map")
    assert truth.ids == ("a", "b")
    assert [frame is None for frame in truth.frames] == [False, True, False, True]
    first = truth.frames[0]
    assert first is not None
    a, b = first.people
    assert a.position_m == pytest.approx([2.0 + BODY.half_depth_m, 0.0, 0.0], abs=1e-9)
    assert a.yaw_rad == pytest.approx(np.pi)
    assert b.yaw_rad is None
    info = read_images(camera, 1, lambda _: None).info
    ground = first.ground_truth(info, first.map_from_camera)
    assert ground.required.tolist() == [True, False]  # b is heavily occluded


def test_person_without_depth_is_interpolated_but_need_not_be_tracked(tmp_path: Path) -> None:
    camera = folder(tmp_path / "wall")
    a = {
        frame: (Mark("a", 5 if frame in (1, 2) else 80 + 10 * frame, 60, None),)
        for frame in (0, 1, 3)
    }
    file = write(tmp_path / "marks.json", camera, a)
    truth = annotated_truth(file, camera, pose(camera), stamps_ns(camera), "map")
    between = truth.frames[1]
    assert between is not None
    assert between.captured == frozenset()
    (person,) = between.people  # a third of the way from 0 to -0.6 m
    assert person.position_m[1] == pytest.approx(-0.2, rel=0.1)


def test_description_in_a_file_survives_a_change(tmp_path: Path) -> None:
    """filinha's file has names, units and flags beside its marks."""
    file = tmp_path / "filinha.json"
    original = json.loads((ROOT / "benchmarks/real_people_marks/filinha.json").read_text())
    file.write_text(json.dumps(original))
    write_marks(file, MarkedImage(200, (Mark("N", 1, 2, 15),)), "abc")
    changed = json.loads(file.read_text())
    assert changed.pop("recording") == "abc"
    extra = changed["marks"].pop()
    assert extra == {"frame": 200, "people": [{"person": "N", "u_px": 1, "v_px": 2, "yaw_deg": 15}]}
    for image in changed["marks"]:
        for mark in image["people"]:
            mark.setdefault("hidden", "no")
    assert changed == original


def test_field_with_a_quotation_mark_survives_a_change(tmp_path: Path) -> None:
    file = tmp_path / "marks.json"
    file.write_text(json.dumps({'a"b': 1}))
    write_marks(file, MarkedImage(0, ()), "abc")
    assert json.loads(file.read_text())['a"b'] == 1


def test_marks_of_absent_images_are_left_out_of_the_agreement(tmp_path: Path) -> None:
    camera = folder(tmp_path / "wall")
    marks = {0: (Mark("a", 80, 60, 0),), FRAMES: (Mark("a", 80, 60, 0),)}
    file = write(tmp_path / "marks.json", camera, marks)
    assert agreement(camera, file, file).frames == 1


def test_current_folder_is_a_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file of annotations is beside the folder."""
    camera = folder(tmp_path / "wall")
    file = write(tmp_path / "wall.annotations.json", camera, {0: (Mark("a", 80, 60, 0),)})
    monkeypatch.chdir(camera.source)
    flags = ["--compare", str(file), "--set", "camera.options.fps=10"]
    result = CliRunner().invoke(app, ["annotate", ".", *flags])
    assert result.exit_code == 0, result.stderr


def test_agreement_of_two_annotators_by_hand(tmp_path: Path) -> None:
    """Ten pixels at 2 m and 100 px focal length are 0.2 m.

    Both mark 3 people; one name is another one's in frame 1. Only the first marks c in frame 1.
    """
    camera = folder(tmp_path / "wall")
    first = {
        0: (Mark("a", 60, 60, 0), Mark("b", 120, 60, 90)),
        1: (Mark("a", 60, 60, 0), Mark("c", 150, 60, None)),
        3: (Mark("a", 60, 60, 0),),
    }
    second = {
        0: (Mark("B", 120, 60, 120), Mark("A", 70, 60, 0)),
        1: (Mark("B", 70, 60, None, "partly"),),
        2: (),
    }
    files = [
        write(tmp_path / f"{k}.json", camera, marks) for k, marks in enumerate((first, second))
    ]
    found = agreement(camera, *files)
    assert (found.frames, found.marks, found.pairs) == (2, (4, 3), 3)
    assert (found.same_identity, found.same_hidden) == (2, 2)
    assert sorted(found.distances_m) == pytest.approx([0.0, 0.2, 0.2])
    assert sorted(found.differences_deg) == [0, 30]
    flags = ["--out", files[0], "--compare", files[1], "--set", "camera.options.fps=10"]
    result = CliRunner().invoke(app, ["annotate", camera.source, *map(str, flags)])
    assert result.exit_code == 0, result.stderr
    lines = [line.split() for line in result.stdout.splitlines()]
    assert ["same", "identity", "67", "%", "3"] in lines
    assert ["distance", "on", "the", "ground,", "median", "0.20", "m", "3"] in lines


def test_annotations_of_another_recording_are_refused(tmp_path: Path) -> None:
    camera, other = folder(tmp_path / "wall"), folder(tmp_path / "other", colour=90)
    file = write(tmp_path / "marks.json", camera, {0: (Mark("a", 80, 60, None),)})
    with pytest.raises(SourceError, match="annotates another recording"):
        annotated_truth(file, other, pose(other), stamps_ns(other), "map")
    with pytest.raises(SourceError, match="annotates another recording"):
        write_marks(file, MarkedImage(1, ()), "abc")
    result = CliRunner().invoke(app, ["annotate", other.source, "--out", str(file), "--port", "0"])
    assert result.exit_code == 1
    assert "Name the recording that was annotated" in result.stderr


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "Expected `object`"),
        ('{"marks": [{"frame": -1, "people": []}]}', ">= 0"),
        ('{"marks": [{"frame": 0, "people": [{"person": "a", "u_px": 1}]}]}', "v_px"),
        ('{"marks": [], "recording": NaN}', "malformed"),
        (
            '{"marks": [{"frame": 0, "people": [{"person": "a", "u_px": -9, "v_px": 1, '
            '"yaw_deg": 0}]}]}',
            ">= 0",
        ),
    ],
)
def test_wrong_file_has_a_clear_error(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "marks.json"
    file.write_text(text)
    with pytest.raises(SourceError, match=message):
        read_annotations(file)


def test_unreadable_images_are_left_out_or_refused(tmp_path: Path) -> None:
    camera = folder(tmp_path / "wall")
    (tmp_path / "wall/rgb/1.png").write_bytes(b"no image")
    assert read_images(camera, 1, lambda _: None).unreadable == 1
    for file in (tmp_path / "wall/rgb").iterdir():
        file.write_bytes(b"no image")
    with pytest.raises(SourceError, match="readable image"):
        read_images(camera, 1, lambda _: None)


def test_wrong_truth_is_refused_before_a_recording_is_played(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    arguments = ["evaluate", "best", "--recordings", str(DEMO), "--cache", str(cache)]
    result = CliRunner().invoke(app, [*arguments, "--truth", str(tmp_path / "none.json")])
    assert result.exit_code == 1
    assert "is no file of annotations" in result.stderr
    assert not cache.exists()


def test_page_states_that_its_file_was_broken(tmp_path: Path) -> None:
    file, config = tmp_path / "marks.json", DashboardConfig(port=0)
    images = read_images(folder(tmp_path / "wall"), 1, lambda _: None)
    page = AnnotationApp("wall", images, file)
    server = WebServer(config, lambda tokens: page.guarded(config, tokens))
    try:
        file.write_text("x")
        with pytest.raises(HTTPError) as raised:
            urlopen(f"{server.address.url}frames", timeout=20)
        assert raised.value.code == 400
        assert b"is no file of annotations" in raised.value.read()
    finally:
        server.close()


def test_number_of_truth_files_must_be_that_of_recordings() -> None:
    arguments = ["evaluate", "best", "--recordings", str(DEMO), "--truth", "a", "--truth", "b"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 1
    assert "expected one file for each of 1 recordings, got 2" in result.stderr
