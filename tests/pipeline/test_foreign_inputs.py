"""Inputs of other systems, if available next to the repository: played correctly or refused.

Each holds 30 frames of the demo recording, or 3, with three people in the layout of another driver,
recorder or exporter.
"""

import importlib
import runpy
import sys
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest

from evaluation.pipeline import lockstep, pipeline, play
from people4d.errors import SourceError
from people4d.messages import F64, Tracks
from services.camera.config import CameraConfig
from services.camera.describe import describe
from services.detector.config import DetectorConfig, ModelSettings
from services.detector.models.registry import load_model
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.sources.registry import open_truth
from services.tracker.config import TrackerConfig
from tests import ROOT, SHARED

CASES = SHARED / "cases"
Positions: TypeAlias = tuple[tuple[float, float, float], ...]
# Median positions of the three people [m]: in the map, and relative to a camera without a pose.
MAP: Positions = ((3.30, 0.81, 1.18), (3.65, -1.09, 1.13), (3.71, -0.11, 1.33))
CAMERA: Positions = ((3.29, 0.81, 0.20), (3.65, -1.09, 0.17), (3.70, -0.11, 0.37))
ODOM: Positions = ((3.80, 0.81, 1.18), (4.15, -1.09, 1.13), (4.21, -0.11, 1.33))
PLAYED = {
    "binning-and-roi/binning": MAP,
    "binning-and-roi/roi": MAP,
    "camera-upside-down/bag": MAP,
    "depth-as-tiff-or-npy/npy": CAMERA,
    "depth-as-tiff-or-npy/tiff": CAMERA,
    "exif-orientation-180/walk": CAMERA,
    "first-depth-image-of-another-size/bag": MAP,
    "kinect2-tiff-depth/kinect2.bag": MAP,
    "librealsense-sdk-bag/sdk.bag": CAMERA,
    "md5sum-star/relay.bag": MAP,
    "names-are-times/walk": CAMERA,
    "oak-bag/bag": CAMERA,
    "odometry-without-map/bag": ODOM,
    "open3d-intrinsics/walk": CAMERA,
    "orbbec-plumb-bob-8/bag": MAP,
    "path-with-hash/run#1": MAP,
    "recorder-killed-mcap-folder/rosbag2_2026_01_01": MAP,
    "simulation-from-0-s-in-a-loop/bag": MAP,
    "static-transforms-on-tf/kinect.bag": CAMERA,
    "two-odometry-topics/bag": ODOM,
}
REFUSED = {
    "depth-smaller-than-colour/walk": "depth is 256x192, colour 640x480",
    "mcap-of-ros1/walk.mcap": "MCAP file of ROS 1",
    "mot-class-and-visibility/gt.txt": "class and visibility",
    "recorder-killed-wal/bag/bag.db3": "bag.db3-wal holds messages",
    "truth-bag-of-poses/vicon.bag": "no people_msgs/People. It has /vicon/1/1",
}
SHORT = ("depth-as-tiff-or-npy", "oak-bag")  # cases of three frames
TOLERANCE_M = 0.05

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CASES.is_dir(), reason="inputs (../shared/cases) are not there"),
]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Path]]:
    """Writes the input of a case, and returns its path; the demo is decoded once for all."""
    folder = tmp_path_factory.mktemp("cases")

    def write(case: str) -> Path:
        name = case.partition("/")[0]
        kit.HERE = folder / name
        kit.HERE.mkdir(exist_ok=True)
        with warnings.catch_warnings(action="ignore"):
            runpy.run_path(str(CASES / name / "make.py"), run_name="__main__")
        return folder / case

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PEOPLE4D_REPO", str(ROOT))
        patch.setenv("PEOPLE4D_CASES", str(folder))
        patch.setattr(sys, "dont_write_bytecode", True)
        patch.syspath_prepend(CASES)
        kit: Any = importlib.import_module("mk")
        yield write


def medians(path: Path, frame_id: str, stride: int) -> list[F64]:
    """Return the median position of each person that is tracked in most of the played frames."""
    found, frames = defaultdict[int, list[F64]](list), 0
    camera = lockstep(CameraConfig(source=str(path), stride=stride))
    tracker = TrackerConfig(frame_id=frame_id)
    for step in play(camera, pipeline(DetectorConfig(), tracker=tracker)):
        for tracks in (message for message in step.messages if isinstance(message, Tracks)):
            frames += 1
            for track in tracks.tracks:
                if track.state == "confirmed":
                    found[track.id].append(track.position_m)
    return [np.median(path_m, axis=0) for path_m in found.values() if len(path_m) > frames / 2]


@pytest.mark.parametrize("case", PLAYED)
def test_input_of_another_system_is_played_right(made: Callable[[str], Path], case: str) -> None:
    path, expected = made(case), PLAYED[case]
    assert describe(path).problem == ""
    stride = 1 if case.startswith(SHORT) else 3
    found = medians(path, "odom" if expected is ODOM else "map", stride)
    assert len(found) == len(expected)
    for position_m in expected:
        assert min(np.abs(one - position_m).max() for one in found) < TOLERANCE_M


@pytest.mark.parametrize("case", REFUSED)
def test_input_that_is_not_read_is_refused_by_name(made: Callable[[str], Path], case: str) -> None:
    path = made(case)
    try:
        if case.startswith(("mot", "truth")):
            open_truth(GtBridgeConfig(truth=str(path)))
            problem = ""
        else:
            problem = describe(path).problem
    except SourceError as error:
        problem = str(error)
    assert REFUSED[case] in problem


def test_truth_with_a_gap_goes_on_after_it(made: Callable[[str], Path]) -> None:
    path = made("truth-with-a-gap/vicon.csv")
    truth = list(open_truth(GtBridgeConfig(truth=str(path))))
    # One of three people is lost for 100 of 901 stamps.
    assert (len(truth), sum(len(one.people) for one in truth)) == (901, 2603)


def test_network_with_nms_inside_is_read(made: Callable[[str], Path]) -> None:
    path = made("yolo-with-nms-inside/pose.onnx")
    assert load_model(ModelSettings(model=str(path))).name == "yolov8-pose:pose"
