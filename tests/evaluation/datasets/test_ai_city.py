"""AI City, track 1: videos and depth of several cameras, 3D boxes, submission and wrong files."""

import importlib.util
import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from common.geometry.transforms import camera_matrix, invert
from common.io.images import decompress
from common.io.recording import open_recording
from common.metrics.record import GroundTruth, Hypotheses
from deploy.cli.system.demo import DEMO
from evaluation.datasets.aicity import AI_CITY
from evaluation.datasets.aicity_files import DEPTH, read_truth
from evaluation.datasets.boxes_3d import Overlap3d
from evaluation.datasets.dataset import DatasetJob
from evaluation.methods import read_method
from people4d.errors import ConfigError, SourceError
from people4d.messages import (
    CameraInfo,
    CompressedRgbdFrame,
    Message,
    RgbdFrame,
    StaticTransform,
    Truth,
)

FRAMES, FIRST = 12, 20
CAMERAS = ("Camera_0000", "Camera_0001")
SCENE = "train/Warehouse_003"
# The library that reads HDF5 is optional: here the depth images are in NPZ files of the same names.
DATASET = replace(AI_CITY, depths=np.load)


@cache
def demo() -> tuple[list[Message], list[RgbdFrame]]:
    """Return everything but frames, and some frames, of the shipped recording of the lab."""
    found = [message for _, message in open_recording(DEMO).messages()]
    frames = [m for m in found if isinstance(m, CompressedRgbdFrame)][FIRST : FIRST + FRAMES]
    return [m for m in found if not isinstance(m, CompressedRgbdFrame)], list(
        map(decompress, frames)
    )


def sensor(name: str) -> dict[str, object]:
    (info,) = (m for m in demo()[0] if isinstance(m, CameraInfo))
    (pose,) = (m for m in demo()[0] if isinstance(m, StaticTransform))
    K = camera_matrix(info)
    P = 2.0 * K @ invert(np.array(pose.matrix))[:3]  # any scale is the same camera
    return {
        "type": "camera",
        "id": name,
        "intrinsicMatrix": K.tolist(),
        "cameraMatrix": P.tolist(),
        "scaleFactor": 1.0,
    }


def objects(frame: RgbdFrame) -> list[dict[str, object]]:
    truths = [m for m in demo()[0] if isinstance(m, Truth)]
    now = min(truths, key=lambda m: abs(m.stamp_ns - frame.stamp_ns))
    found = [
        {
            "object type": "Person",
            "object id": int(person.id),
            "3d location": [*person.position_m[:2].tolist(), 0.875],
            "3d bounding box scale": [0.6, 0.6, 1.75],
            "3d bounding box rotation": [0.0, 0.0, person.yaw_rad],
            "2d bounding box visible": {},
        }
        for person in now.people
    ]
    return [*found, {**found[0], "object type": "Forklift", "object id": 77}]


def write_scene(folder: Path, scene: str = SCENE) -> Path:
    """Write a scene whose two cameras stand at the same place."""
    path = folder / scene
    (path / "videos").mkdir(parents=True)
    (path / "depth_maps").mkdir()
    frames = demo()[1]
    (path / "calibration.json").write_text(json.dumps({"sensors": list(map(sensor, CAMERAS))}))
    if not scene.startswith("test"):
        truth = {str(k): objects(frame) for k, frame in enumerate(frames)}
        (path / "ground_truth.json").write_text(json.dumps(truth))
    depths = {DEPTH.format(k): frame.depth_mm for k, frame in enumerate(frames)}
    for name in CAMERAS:
        write_video(path / "videos" / f"{name}.mp4", frames)
        with (path / "depth_maps" / f"{name}.h5").open("wb") as file:
            np.savez(file, allow_pickle=False, **depths)
    return path


def write_video(path: Path, frames: list[RgbdFrame]) -> None:
    height, width = frames[0].depth_mm.shape
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 30.0, (width, height))
    for frame in frames:
        writer.write(np.ascontiguousarray(frame.rgb[..., ::-1]))
    writer.release()


def people(**columns: object) -> GroundTruth:
    return GroundTruth(ids=(1,), positions_m=np.array([[0.0, 0.0, 1.0]]), **columns)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("moved_m", "yaw_rad", "overlap"),
    [
        ((0.0, 0.0, 0.0), 0.0, 1.0),
        # Half of the volume of 2 x 1 x 2 m is common: 2 / (4 + 4 - 2).
        ((1.0, 0.0, 0.0), 0.0, 1 / 3),
        ((0.0, 0.0, 1.0), 0.0, 1 / 3),
        # Turned by a right angle only the square of 1 m is common: 2 / (4 + 4 - 2).
        ((0.0, 0.0, 0.0), np.pi / 2, 1 / 3),
        ((5.0, 0.0, 0.0), 0.0, 0.0),
        ((0.0, 0.0, 3.0), 0.0, 0.0),
    ],
)
def test_overlap_of_boxes_with_yaw(
    moved_m: tuple[float, ...], yaw_rad: float, overlap: float
) -> None:
    similarity = Overlap3d({1: np.array([2.0, 1.0, 2.0])}, (2.0, 1.0, 2.0))
    truth = people(yaws_rad=np.array([0.0]))
    tracked = Hypotheses(
        ids=(9,), positions_m=np.array([[0.0, 0.0, 1.0]]) + moved_m, yaws_rad=np.array([yaw_rad])
    )
    assert similarity(truth, tracked) == pytest.approx(np.array([[overlap]]), abs=1e-5)


def test_people_before_two_cameras_are_tracked_once(tmp_path: Path) -> None:
    write_scene(tmp_path)
    assert list(DATASET.sequences(tmp_path)) == [SCENE]
    result = DATASET.evaluate(DatasetJob(tmp_path, SCENE, read_method("best"), tmp_path))
    assert result.figures is not None
    row = result.figures.row()
    count = len(objects(demo()[1][0])) - 1  # without the forklift
    assert row["truths"] == FRAMES * count
    assert row["id_switches"] == 0
    assert row["hota"] is not None
    assert row["hota"] > 0.7
    lines = [line.split() for line in result.submission["train/track1.txt"].splitlines()]
    assert {len(line) for line in lines} == {11}
    assert {tuple(line[:2]) for line in lines} == {("3", "0")}  # scene and class
    assert {tuple(line[7:10]) for line in lines} == {("0.6", "0.6", "1.75")}
    assert len({line[2] for line in lines}) <= count + 1


def test_half_a_download_is_named(tmp_path: Path) -> None:
    (write_scene(tmp_path) / "depth_maps" / f"{CAMERAS[1]}.h5").unlink()
    with pytest.raises(SourceError, match=r"depth_maps: expected Camera_0001.h5, got Camera_0000"):
        DATASET.sequences(tmp_path)


def test_calibration_of_2024_is_refused(tmp_path: Path) -> None:
    path = write_scene(tmp_path) / "calibration.json"
    path.write_text(json.dumps({"camera projection matrix": [], "homography matrix": []}))
    with pytest.raises(
        SourceError, match=r"calibration.json: expected the layout of 2025, got Obj"
    ):
        DATASET.sequences(tmp_path)


def test_truth_of_a_longer_scene_is_refused(tmp_path: Path) -> None:
    path = write_scene(tmp_path)
    with pytest.raises(SourceError, match=r"expected frames 0 to 4 as in the videos, got frame 11"):
        read_truth(DATASET, path, 5)


def test_cameras_with_different_numbers_of_frames_are_refused(tmp_path: Path) -> None:
    path = write_scene(tmp_path)
    write_video(path / "videos" / f"{CAMERAS[1]}.mp4", demo()[1][:2])
    with pytest.raises(SourceError, match=r"number of frames of each, got fewer of Camera_0001"):
        list(DATASET.detections(path, read_method("best")))


def test_frames_without_depth_are_refused(tmp_path: Path) -> None:
    path = write_scene(tmp_path)
    with (path / "depth_maps" / f"{CAMERAS[0]}.h5").open("wb") as file:
        np.savez(file, allow_pickle=False, **{DEPTH.format(0): demo()[1][0].depth_mm})
    with pytest.raises(SourceError, match=r"expected distance_to_image_plane_00001.png in its .h5"):
        list(DATASET.detections(path, read_method("best")))


def test_depth_images_of_hdf5_or_the_package_to_install(tmp_path: Path) -> None:
    path = tmp_path / "Camera_0000.h5"
    if importlib.util.find_spec("h5py") is None:
        with pytest.raises(ConfigError, match="Install the package h5py"):
            AI_CITY.depths(path)
        return
    depth_mm = demo()[1][0].depth_mm
    with importlib.import_module("h5py").File(path, "w") as file:
        file.create_dataset(DEPTH.format(0), data=depth_mm)
    images = AI_CITY.depths(path)
    assert DEPTH.format(1) not in images
    np.testing.assert_array_equal(np.asarray(images[DEPTH.format(0)]), depth_mm)


def test_validation_split_is_refused_for_tuning() -> None:
    AI_CITY.check_tuning([SCENE])
    with pytest.raises(ConfigError, match="got val/Hospital_000"):
        AI_CITY.check_tuning(["val/Hospital_000"])
