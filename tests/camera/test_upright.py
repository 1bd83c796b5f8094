"""Cameras that are mounted upside down or sideways."""

import math
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from common.calibration.transforms_file import MAP
from common.geometry.transforms import LINK_FROM_OPTICAL, invert, rotation_from_rpy, transform_from
from people4d.messages import F64, CameraInfo, Message, RgbdFrame, StaticTransform
from services.camera.calibration import Intrinsics, camera_info, static_transform
from services.camera.config import CameraConfig
from services.camera.node import CameraNode
from services.camera.source import SourceFrame
from services.camera.upright import quarter_turns, turned_info, turned_transforms
from tests.camera.memory import SIZE, MemorySource

LENS = Intrinsics(fx=10, fy=11, cx=4.5, cy=2.5, distortion=(0.1, -0.05, 0.01, -0.02, 0.03))
INFO = camera_info(LENS, SIZE)
FRAME = INFO.frame_id


def pose(roll_deg: float, pitch_deg: float = 10.0, yaw_deg: float = 40.0) -> F64:
    """Pose of the optical frame in the map of a camera with this roll about its own axis."""
    roll, pitch, yaw = (math.radians(angle) for angle in (roll_deg, pitch_deg, yaw_deg))
    return transform_from((1.0, 2.0, 1.5), rotation_from_rpy(roll, pitch, yaw)) @ LINK_FROM_OPTICAL


@pytest.mark.parametrize(
    ("roll_deg", "turns"), [(0, 0), (40, 0), (-40, 0), (90, 1), (180, 2), (-90, 3), (135.1, 2)]
)
def test_turns_follow_the_roll(roll_deg: float, turns: int) -> None:
    # A camera rolled by 90 degrees to its right sees the floor on its right-hand side.
    found = quarter_turns(pose(roll_deg))
    assert found == turns


def test_camera_facing_the_floor_is_not_turned() -> None:
    assert quarter_turns(pose(180, pitch_deg=80)) == 0
    assert quarter_turns(pose(180, pitch_deg=-80)) == 0


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_point_is_where_the_turned_image_shows_it(turns: int) -> None:
    # A point in the map is projected by the camera, and by the turned camera: the pixel of the one
    # image, turned, is the pixel of the other.
    camera = static_transform(MAP, FRAME, pose(0))
    turned = turned_info(INFO, turns)
    own, other = turned_transforms([camera], FRAME, turned, turns)
    point = own.matrix @ (0.05, -0.08, 2.0, 1.0)
    (u, v), (turned_u, turned_v) = project(INFO, own, point), project(turned, other, point)
    height, width = SIZE
    for _ in range(turns):
        u, v, height, width = height - 1 - v, u, width, height
    assert (turned.height, turned.width) == (height, width)
    assert (turned_u, turned_v) == pytest.approx((u, v), abs=1e-9)
    assert turned.frame_id == other.child == f"upright_{FRAME}"


def project(info: CameraInfo, camera: StaticTransform, point: F64) -> tuple[float, float]:
    at = (invert(camera.matrix) @ point)[:3]
    k = np.array([[info.fx, 0, info.cx], [0, info.fy, info.cy], [0, 0, 1]])
    pixels, _ = cv2.projectPoints(
        at.reshape(1, 3), np.zeros(3), np.zeros(3), k, np.array(info.distortion)
    )
    u, v = pixels.ravel().tolist()
    return u, v


def published(config: CameraConfig) -> tuple[CameraInfo, list[StaticTransform], RgbdFrame]:
    rgb, depth_mm = np.zeros((*SIZE, 3), np.uint8), np.zeros(SIZE, np.uint16)
    rgb[0, 0], depth_mm[0, 0] = 200, 900
    node = CameraNode(config, MemorySource([SourceFrame(rgb, depth_mm, 1)]))
    found: list[Message] = []
    while not node.is_finished():
        found += node.tick(10**12 + len(found))
    node.close()
    info, *transforms, frame = found
    assert isinstance(info, CameraInfo)
    assert isinstance(frame, RgbdFrame)
    return info, [t for t in transforms if isinstance(t, StaticTransform)], frame


def test_images_of_a_camera_upside_down_are_published_upright() -> None:
    config = CameraConfig(mount_rpy_rad=(math.pi, 0.0, 0.0), start_delay_s=0.0)
    info, (own, upright), frame = published(config)
    assert (frame.rgb[-1, -1, 0], frame.depth_mm[-1, -1], frame.rgb[0, 0, 0]) == (200, 900, 0)
    assert (info.frame_id, upright.child) == (upright.child, f"upright_{own.child}")
    assert quarter_turns(own.matrix) == 2
    assert quarter_turns(upright.matrix) == 0


def test_sideways_camera_is_published_in_portrait() -> None:
    config = CameraConfig(mount_rpy_rad=(math.pi / 2, 0.0, 0.0), start_delay_s=0.0)
    info, _, frame = published(config)
    assert (info.height, info.width) == frame.depth_mm.shape == (8, 6)
    assert frame.depth_mm[0, -1] == 900  # clockwise


@pytest.mark.parametrize("rotate", [0, 90, 180, 270])
def test_rotation_by_a_setting_turns_images_below_an_upright_mount(rotate: int) -> None:
    config = {"rotate": rotate, "mount_xyz_m": (0, 0, 1.5), "mount_rpy_rad": (0, 0.1, 0)}
    node = CameraNode(msgspec.convert(config, CameraConfig), MemorySource([]))
    messages = node.tick(0)
    node.close()
    (info,) = (one for one in messages if isinstance(one, CameraInfo))
    turned = info.width == SIZE[0]
    assert turned == (rotate in (90, 270))
    poses = {one.child: one.matrix for one in messages if isinstance(one, StaticTransform)}
    upright = transform_from((0, 0, 1.5), rotation_from_rpy(0, 0.1, 0)) @ LINK_FROM_OPTICAL
    np.testing.assert_allclose(poses[info.frame_id], upright, atol=1e-12)
    assert quarter_turns(poses[info.frame_id.removeprefix("upright_")]) == rotate // 90


def test_upright_camera_keeps_its_frame_and_images() -> None:
    info, transforms, frame = published(CameraConfig(start_delay_s=0.0))
    assert [t.child for t in transforms] == [info.frame_id]
    assert frame.depth_mm[0, 0] == 900


@pytest.mark.parametrize("calibrated_roll_deg", [0, 180])
def test_calibrated_pose_is_of_the_turned_images_if_it_is_upright(
    tmp_path: Path, calibrated_roll_deg: float
) -> None:
    matrix = pose(calibrated_roll_deg)
    file = tmp_path / "transforms.toml"
    rows = "\n".join(f"  {row}," for row in matrix.tolist())
    file.write_text(
        f'reference = "camera"\n[cameras.camera]\nframe_id = "a"\nmatrix = [\n{rows}\n]\n'
    )
    config = CameraConfig(
        mount_rpy_rad=(math.pi, 0.0, 0.0), transforms=str(file), start_delay_s=0.0
    )
    info, transforms, frame = published(config)
    assert frame.depth_mm[-1, -1] == 900
    upright = next(t for t in transforms if t.child == info.frame_id)
    assert quarter_turns(upright.matrix) == 0
