"""AprilTags in images: poses of cameras in the map, and refusals of ambiguous tags."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from common.calibration.solve import calibrate
from common.calibration.tags import FAMILY, Tag, TagObserver, move_to_map, read_tags
from common.geometry.transforms import apply, invert, project, transform_from
from people4d.errors import CalibrationError, SourceError
from people4d.messages import F64, U8, CameraInfo
from tests.builders import camera_info
from tests.common.calibration.walks import camera, observe, square, wander

CELLS, CELL_PX = 8, 20  # number of cells of a tag with its border, and size of a cell
FINE = 4  # pixels of the drawing in one of the image
WALL = Tag(size_m=0.4, position_m=(2.0, 0.6, 1.3), facing_deg=180)
SIDE = Tag(size_m=0.4, position_m=(1.2, -1.6, 1.2), facing_deg=90)
FLOOR = Tag(size_m=0.5, position_m=(0.6, 0.1, 0.0), facing_deg=-90, flat=True)
INFO = camera_info(
    camera="c",
    width=640,
    height=480,
    fx=500.0,
    fy=505.0,
    cx=322.0,
    cy=238.0,
    distortion_model="plumb_bob",
    distortion=(0.02, -0.01, 0.0, 0.0, 0.0),
)
POSE = camera("c", -2.5, -0.2, 0.0).map_from_camera


def image_of(tags: dict[int, Tag], pose: F64, info: CameraInfo = INFO) -> U8:
    """Draw tags before a grey wall, by the projection of their corners."""
    family = cv2.aruco.getPredefinedDictionary(FAMILY)
    size = (FINE * info.width, FINE * info.height)
    image = np.full(size[::-1], 150, np.uint8)
    side = CELLS * CELL_PX
    for number, tag in tags.items():
        marker = cv2.aruco.generateImageMarker(family, number, side)
        paper = np.pad(marker, 2 * CELL_PX, constant_values=255)
        # Corners of the tag in pixels of the paper; (0, 0) is the centre of the first pixel.
        low, high = 2 * CELL_PX - 0.5, 2 * CELL_PX + side - 0.5
        corners = np.array([[low, low], [high, low], [high, high], [low, high]], np.float32)
        pixels = FINE * (project(apply(invert(pose), tag.corners_m), info) + 0.5) - 0.5
        warp = cv2.getPerspectiveTransform(corners, pixels.astype(np.float32))
        drawn = cv2.warpPerspective(paper, warp, size)
        mask = cv2.warpPerspective(np.full_like(paper, 255), warp, size)
        image = np.where(mask > 127, drawn, image)
    image = cv2.resize(image, (info.width, info.height), interpolation=cv2.INTER_AREA)
    return np.repeat(image[:, :, None], 3, axis=2)


def poses(shown: dict[int, Tag], known: dict[int, Tag]) -> dict[str, F64]:
    observer = TagObserver(known)
    for k in range(3):
        assert observer.wants("c", k * 10**9)
        observer.add_image("c", k * 10**9, image_of(shown, POSE))
        assert not observer.wants("c", k * 10**9 + 10**8)
    return observer.copy().poses({"c": INFO})


def test_pose_of_a_camera_before_tags_on_two_walls_and_the_floor() -> None:
    tags = {3: WALL, 7: SIDE, 11: FLOOR}
    found = poses(tags, tags)["c"]
    apart = invert(POSE) @ found
    assert np.linalg.norm(apart[:3, 3]) < 0.006
    assert np.linalg.norm(cv2.Rodrigues(apart[:3, :3])[0]) < np.radians(0.1)


def test_tags_that_are_not_in_the_file_are_left_out() -> None:
    assert poses({3: WALL, 8: SIDE}, {5: WALL}) == {}


@pytest.mark.parametrize(
    ("known", "problem"),
    [
        ({3: WALL, 7: WALL}, "not where the file says, by c"),
        ({3: WALL, 7: Tag(size_m=0.1, position_m=SIDE.position_m, facing_deg=90)}, "not where"),
    ],
)
def test_wrong_files_are_refused(known: dict[int, Tag], problem: str) -> None:
    with pytest.raises(CalibrationError, match=problem):
        poses({3: WALL, 7: SIDE}, known)


def test_one_small_tag_far_away_leaves_two_poses() -> None:
    small = Tag(size_m=0.17, position_m=(2.4, -0.2, 1.0), facing_deg=180)
    with pytest.raises(CalibrationError, match="tag 3: leave two poses of c"):
        poses({3: small}, {3: small})


def test_a_calibration_by_walking_is_moved_to_the_map_of_the_tags() -> None:
    cameras = square("a", "b")
    walked = calibrate(observe(cameras, [wander(3), wander(4)]))
    truth = {one.name: one.map_from_camera for one in cameras}
    found = move_to_map(walked, truth)
    for name, pose in truth.items():
        assert np.linalg.norm(found.map_from_camera[name][:3, 3] - pose[:3, 3]) < 0.04
    path = np.concatenate(found.paths_m["a"])
    assert np.abs(path[:, :2]).max() < 4.0
    only_a = move_to_map(walked, {"a": truth["a"]}).map_from_camera["b"]
    assert np.linalg.norm(only_a[:3, 3] - truth["b"][:3, 3]) < 0.15
    with pytest.raises(CalibrationError, match="no camera saw a tag"):
        move_to_map(walked, {})
    moved = {**truth, "b": transform_from((0.5, 0, 0), np.eye(3)) @ truth["b"]}
    with pytest.raises(
        CalibrationError, match=r"tags place a 2\d cm and .* from the pose estimated from walking"
    ):
        move_to_map(walked, moved)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "expected 1 to 200 tags, got 0"),
        ("[tags]", "expected 1 to 200 tags, got 0"),
        ("[tags.x]\nsize_m = 0.1\nposition_m = [0, 0, 0]\nfacing_deg = 0", "invalid literal"),
        ("[tags.1]\nsize_m = -1\nposition_m = [0, 0, 0]\nfacing_deg = 0", "0.01"),
        ("[tags.1]\nsize_m = 0.1\nposition_m = [0, 0]\nfacing_deg = 0", "length 3"),
        ("[tags.1]\nsize_m = nan\nposition_m = [0, 0, 0]\nfacing_deg = 0", "size_m"),
    ],
)
def test_bad_files_are_refused(tmp_path: Path, text: str, problem: str) -> None:
    file = tmp_path / "tags.toml"
    file.write_text(text)
    with pytest.raises(SourceError, match=problem):
        read_tags(file)
    with pytest.raises(SourceError, match="cannot be read"):
        read_tags(tmp_path / "absent.toml")
