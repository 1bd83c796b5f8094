"""Walking people in front of cameras, without bodies: torsos, ankles and shoulders as points."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from common.calibration.observations import CameraObservations, ObservationCollector
from common.geometry.transforms import (
    LINK_FROM_OPTICAL,
    apply,
    deproject,
    invert,
    project,
    rotation_from_rpy,
    transform_from,
)
from people4d.messages import F64, U16, CameraInfo, Detection, Detections
from tests.builders import camera_info

Path = Callable[[float], tuple[float, float]]  # time [s] -> x, y [m], frame: map
TORSO_M, SHOULDER_M, ANKLE_M = 1.1, 1.4, 0.12
SECOND_NS = 10**9
EPOCH_NS = 1_000 * SECOND_NS


@dataclass(frozen=True)
class WalkCamera:
    """A camera, and its clock."""

    name: str
    map_from_camera: F64
    rate_hz: float = 10.0
    offset_s: float = 0.0  # offset of its stamps
    delay_s: float = 0.05  # delay of its messages
    scale: float = 1.0  # scale of offsets across the axis: wrong focal length
    near_m: float = 0.0  # offset of positions in front of the person


def camera(name: str, x: float, y: float, yaw_deg: float, **fields: float) -> WalkCamera:
    """Build a camera 2.2 m high, pitched down by 15 degrees."""
    turn = rotation_from_rpy(0.02, math.radians(15), math.radians(yaw_deg))
    pose = transform_from((x, y, 2.2), turn) @ LINK_FROM_OPTICAL
    return WalkCamera(name, pose, **fields)


def square(*names: str) -> list[WalkCamera]:
    """Build cameras at the corners of a square of 6 m, which look at its middle."""
    corners = [(-3.0, -3.0, 45.0), (3.0, -3.0, 135.0), (3.0, 3.0, -135.0), (-3.0, 3.0, -45.0)]
    rates, offsets = (10.0, 15.0, 12.0, 7.5), (0.0, 0.21, -0.13, 0.05)
    return [
        camera(name, x, y, yaw, rate_hz=rate, offset_s=offset)
        for name, (x, y, yaw), rate, offset in zip(names, corners, rates, offsets, strict=False)
    ]


def wander(seed: int, side_m: float = 1.9) -> Path:
    """Return a smooth path about the origin, at about 1 m/s."""
    rng = np.random.default_rng(seed)
    phases, rates = rng.uniform(0, 2 * math.pi, (2, 3)), rng.uniform(0.2, 0.75, (2, 3))

    def path(t_s: float) -> tuple[float, float]:
        x, y = np.sin(rates * t_s + phases).sum(axis=1) / 3 * 1.6 * side_m
        return float(x), float(y)

    return path


def observe(
    cameras: Sequence[WalkCamera],
    paths: Sequence[Path],
    duration_s: float = 20.0,
    noise_m: float = 0.02,
    seed: int = 0,
) -> list[CameraObservations]:
    """Return what cameras see of people."""
    collector = ObservationCollector()
    for arrived_ns, message in messages(cameras, paths, duration_s, noise_m, seed):
        collector.add_message(message, arrived_ns)
    return collector.cameras


def messages(
    cameras: Sequence[WalkCamera],
    paths: Sequence[Path],
    duration_s: float = 20.0,
    noise_m: float = 0.02,
    seed: int = 0,
) -> Iterator[tuple[int, CameraInfo | Detections]]:
    """Yield the messages of cameras with their times of arrival, camera by camera."""
    rng = np.random.default_rng(seed)
    for one in cameras:
        info = camera_info(camera=one.name, frame_id=f"{one.name}_optical_frame")
        yield 0, info
        for k in range(int(duration_s * one.rate_hz)):
            t_s = k / one.rate_hz
            stamp_ns = EPOCH_NS + round((t_s + one.offset_s) * 1e9)
            found = [d for p in paths if (d := _detection(one, info, p(t_s), noise_m, rng))]
            frame = Detections(
                stamp_ns=stamp_ns,
                sequence=k,
                camera=one.name,
                frame_id=info.frame_id,
                model="walk",
                width=640,
                height=480,
                detections=tuple(found),
            )
            yield round((t_s + one.delay_s) * 1e9), frame


def _detection(
    one: WalkCamera,
    info: CameraInfo,
    at: tuple[float, float],
    noise_m: float,
    rng: np.random.Generator,
) -> Detection | None:
    heights = np.array([TORSO_M, SHOULDER_M, ANKLE_M])
    points = np.column_stack([np.full(3, at[0]), np.full(3, at[1]), heights])
    optical = apply(invert(one.map_from_camera), points)
    if optical[:, 2].min() < 0.5 or optical[0, 2] > 5:
        return None
    pixels = project(optical, info)
    u, v = pixels[0]
    if not (20 < u < 620 and 20 < v < 460):
        return None
    pixels = (pixels - (info.cx, info.cy)) * one.scale + (info.cx, info.cy)
    keypoints = np.zeros((17, 3), np.float32)
    keypoints[[5, 6], :2], keypoints[[15, 16], :2] = pixels[1], pixels[2]
    keypoints[[5, 6, 15, 16], 2] = 0.9
    ray = optical[0] / np.linalg.norm(optical[0])
    position = optical[0] - one.near_m * ray + rng.normal(0, noise_m, 3)
    return Detection(
        box_xyxy_px=np.array([u - 20, v - 60, u + 20, v + 60], np.float32),
        score=0.9,
        keypoints=keypoints,
        position_m=position * (one.scale, one.scale, 1.0),
    )


def floor_depth_mm(
    one: WalkCamera,
    level_m: float = 0.0,
    tilt_deg: float = 0.0,
    table: bool = False,
    noise_m: float = 0.01,
    seed: int = 0,
) -> U16:
    """Return the depth of a floor, HxW.

    Args:
        one: Camera that sees it.
        level_m: Height of it at the origin of the map.
        tilt_deg: Tilt of it about x of the map.
        table: A table 0.75 m high stands in the left half of the image.
        noise_m: Standard deviation of each reading.
        seed: Of the noise.
    """
    info = camera_info(camera=one.name)
    v, u = np.mgrid[: info.height, : info.width]
    rays = deproject(np.column_stack([u.ravel(), v.ravel()]), np.ones(u.size), info)
    turned = rays @ one.map_from_camera[:3, :3].T
    tilt = math.radians(tilt_deg)
    normal = np.array([0.0, math.sin(tilt), math.cos(tilt)])
    levels = np.where(table & (u.ravel() < info.width // 2), level_m + 0.75, level_m)
    with np.errstate(divide="ignore"):
        depth_m = (levels - one.map_from_camera[:3, 3] @ normal) / (turned @ normal)
    depth_m = depth_m + np.random.default_rng(seed).normal(0, noise_m, depth_m.shape)
    is_read = (depth_m > 0.3) & (depth_m < info.max_depth_m)
    return np.asarray(np.where(is_read, 1000 * depth_m, 0).reshape(v.shape), np.uint16)
