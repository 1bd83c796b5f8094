"""Frames of the virtual lab in the layouts of TUM RGB-D, KTP, RIMT and TPT-Bench."""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from common.io.recording import open_recording
from lab.catalogue import load_scenario
from lab.depth.metadata import read_metadata
from lab.truth.silhouette import silhouettes
from lab.world import EPOCH_NS, World
from people4d.messages import F64, U8, U16, CameraInfo
from services.camera.source import SourceFrame
from services.camera.sources import open_source
from tests import ROOT
from tests.camera.ros.bags import Entry, Ros

DEMO = ROOT / "deploy" / "demo" / "crossing.mcap"
FIRST, STEP, COUNT = 30, 2, 12  # frames of the demo at 7.5 Hz
OFFSET_S = 1_341_846_313  # time of the first frame
SEQUENCE = "rgbd_dataset_freiburg3_walking_xyz"


@dataclass(frozen=True)
class LabFrame:
    """One pair of images with its people."""

    stamp_ns: int
    rgb: U8
    depth_mm: U16
    boxes_px: dict[int, tuple[int, int, int, int]]  # left, top, width, height of visible people
    positions_m: dict[int, F64]  # in the map

    @property
    def time(self) -> str:
        """Time in seconds as text."""
        return f"{self.stamp_ns // 10**9}.{self.stamp_ns % 10**9:09}"


@cache
def lab_frames() -> tuple[LabFrame, ...]:
    """Return frames of the demo with the people of its scenario."""
    note = read_metadata(open_recording(DEMO))
    assert note is not None
    world = World(load_scenario(note.scenario), note.seed)
    captures = [item for item in open_source(str(DEMO)) if isinstance(item, SourceFrame)]
    frames = []
    for capture in captures[FIRST : FIRST + STEP * COUNT : STEP]:
        t_s = (capture.stamp_ns - EPOCH_NS) / 1e9
        people = world.keypoints_m(t_s)
        found = silhouettes(people, world.optical_from_map(t_s), world.info)
        shown = {k: one for k, one in found.items() if one.visible_share > 0.3}
        corners = {k: np.rint(one.box_xyxy_px).astype(int) for k, one in shown.items()}
        boxes = {k: (*b[:2].tolist(), *(b[2:] - b[:2]).tolist()) for k, b in corners.items()}
        torsos_m = {k: people[k][[5, 6, 11, 12]].mean(axis=0) for k in shown}  # torso
        stamp_ns = capture.stamp_ns - captures[FIRST].stamp_ns + OFFSET_S * 10**9
        frames.append(LabFrame(stamp_ns, capture.rgb, capture.depth_mm, boxes, torsos_m))
    return tuple(frames)


def camera() -> tuple[CameraInfo, F64]:
    """Return the camera of the frames, and its pose (4x4) in the map."""
    source = open_source(str(DEMO))
    (transform,) = source.transforms
    source.close()
    return source.info, transform.matrix


def write_tum(folder: Path) -> Path:
    """Write a sequence; the camera stands."""
    path = folder / SEQUENCE
    lists: dict[str, list[str]] = {"rgb": [], "depth": []}
    for one in lab_frames():
        for kind, lines in lists.items():
            (path / kind).mkdir(parents=True, exist_ok=True)
            lines.append(f"{one.time[:-3]} {kind}/{one.time[:-3]}.png\n")
        _write(path / "rgb" / f"{one.time[:-3]}.png", one.rgb[..., ::-1])
        depth = np.where(one.depth_mm < 13_000, one.depth_mm * 5, 0).astype(np.uint16)
        _write(path / "depth" / f"{one.time[:-3]}.png", depth)
    for kind, lines in lists.items():
        (path / f"{kind}.txt").write_text(
            f"# {kind} images\n# timestamp filename\n{''.join(lines)}"
        )
    _, pose = camera()
    quaternion = Rotation.from_matrix(pose[:3, :3]).as_quat()
    values = " ".join(f"{x:.4f}" for x in (*pose[:3, 3], *quaternion))
    times = np.arange(OFFSET_S, OFFSET_S + 3, 0.01)
    lines = [f"{time_s:.4f} {values}\n" for time_s in times]
    (path / "groundtruth.txt").write_text(f"# timestamp tx ty tz qx qy qz qw\n{''.join(lines)}")
    return path


def write_ktp(folder: Path) -> Path:
    """Write the sequence Still."""
    lines = []
    for one in lab_frames():
        for kind, end, image in (
            ("rgb", "jpg", one.rgb[..., ::-1]),
            ("depth", "pgm", one.depth_mm),
        ):
            (folder / "images" / "Still" / kind).mkdir(parents=True, exist_ok=True)
            _write(folder / "images" / "Still" / kind / f"{one.time}.{end}", image)
        people = "".join(f" {k} {' '.join(map(str, box))}," for k, box in one.boxes_px.items())
        lines.append(f"{one.time}:{people}\n")
    (folder / "ground_truth").mkdir()
    (folder / "ground_truth" / "Still_gt2D.txt").write_text("".join(lines))
    return folder


def write_rimt(folder: Path, *, truth: bool = True, shift_ns: int = 0) -> Path:
    """Write the bag of one sequence, its truth late by some nanoseconds, or without truth."""
    ros, (info, pose), entries = Ros(1), camera(), list[Entry]()
    optical = "head_camera_rgb_optical_frame"
    quaternion = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
    start_ns = OFFSET_S * 10**9
    link = ros.transform("map", optical, pose[:3, 3].tolist(), quaternion, start_ns)
    entries.append(("/tf_static", start_ns, link))
    for one in lab_frames():
        calibration = ros.make(
            "sensor_msgs/msg/CameraInfo",
            header=ros.header(one.stamp_ns, optical),
            height=info.height,
            width=info.width,
            distortion_model="plumb_bob",
            D=np.zeros(5),
            K=np.array([info.fx, 0, info.cx, 0, info.fy, info.cy, 0, 0, 1.0]),
            R=np.eye(3).ravel(),
            P=np.zeros(12),
        )
        messages = {
            "/head_camera/rgb/camera_info": calibration,
            "/head_camera/depth/camera_info": calibration,
            "/head_camera/rgb/image_rect_color": ros.image(
                one.rgb, "rgb8", one.stamp_ns, frame=optical
            ),
            "/head_camera/depth/image_rect": ros.image(
                one.depth_mm, "16UC1", one.stamp_ns, frame=optical
            ),
        }
        for k, position_m in one.positions_m.items() if truth else ():
            point = dict(zip("xyz", position_m.tolist(), strict=True))
            header = ros.header(one.stamp_ns + shift_ns, "map")
            messages[f"/3D_ground_truth_{k}"] = ros.make(
                "geometry_msgs/msg/PoseStamped", header=header, pose={"position": point}
            )
        entries += [(topic, one.stamp_ns, message) for topic, message in messages.items()]
    bags = folder / "Manually_annotated_bags"
    bags.mkdir(parents=True)
    ros.write(bags / "still.bag", entries)
    return folder


def write_tpt(folder: Path) -> Path:
    """Write sequence 0000, in which the target is absent from the last image."""
    frames, truth = lab_frames(), {}
    target = min(frames[0].boxes_px)
    for number, one in enumerate(frames):
        box = one.boxes_px.get(target) if number < len(frames) - 1 else None
        truth[str(one.stamp_ns)] = {"is_exist": box is not None, "bbox": box or (0, 0, 0, 0)}
        images = folder / "panoramic_images" / "0000"
        images.mkdir(parents=True, exist_ok=True)
        _write(images / f"{one.stamp_ns}.jpg", one.rgb[..., ::-1])
    (folder / "GTs").mkdir()
    (folder / "GTs" / "0000.json").write_text(json.dumps(truth))
    return folder


def _write(path: Path, image: U8 | U16) -> None:
    assert cv2.imwrite(str(path), np.ascontiguousarray(image))
