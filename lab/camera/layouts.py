"""Layouts of several cameras: fixed ones with rates and clocks of their own, and one on a robot."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lab.camera.plan import CameraPlan, Drive, ImagePlan
from lab.depth.config import SensorName

Layout = Literal["ring", "row", "apart"]
Clocks = Literal["alike", "free"]
Floor = tuple[tuple[float, float], tuple[float, float]]  # [m] lower and upper corner, frame: map

RING_M = 3.6  # radius of a ring of four; five and six stand further out
RING_GROWTH_M = 0.35  # for each camera above four
ROW_M, APART_M = 2.8, 6.0  # between cameras in a row: views overlap a little; views are apart
INSIDE_M = 0.8  # people stay so far inside of a ring
LENGTH_M = 21.6  # longest row
NEAR_M, FAR_M = 1.6, (4.4, 3.5)  # depth of the floor before a row of up to four, and of more
HEIGHTS_M, PITCHES_DEG = (2.0, 2.4), (14.0, 22.0)
RATES_HZ = (10.0, 15.0, 12.5, 15.0, 7.5, 15.0)  # of free clocks, by camera
OFFSET_S, DRIFT_PPM = 0.3, 60.0  # largest, of free clocks
DRIVE_MPS, DRIVE_S, TURN_DPS = 0.25, 6.0, 12.0


@dataclass(frozen=True)
class LayoutPlan:
    """Cameras, and the floor that they are for."""

    cameras: tuple[CameraPlan, ...]
    floor: Floor


@dataclass(frozen=True)
class Spacing:
    """Layout of cameras about the floor."""

    layout: Layout
    row_m: float = ROW_M  # between cameras in a row

    def step_m(self, count: int) -> float:
        """Return the distance of neighbours in a row, or apart."""
        if self.layout == "row":
            return self.row_m
        return min(APART_M, LENGTH_M / max(count - 1, 1))


@dataclass(frozen=True)
class CameraModel:
    """Image and rate common to the cameras of a layout."""

    width: int  # [px]
    height: int  # [px]
    focal_px: float
    fps: float  # [Hz], of clocks that are alike
    depth_sensor: SensorName
    image: ImagePlan
    duration_s: float  # [s] of the scene, for which a robot drives


def lay_out(
    count: int,
    spacing: Spacing,
    clocks: Clocks,
    robot: bool,
    model: CameraModel,
    rng: np.random.Generator,
) -> LayoutPlan:
    """Return cameras about the origin, named c1, c2, ... and `robot`.

    Args:
        count: Number of cameras, with that of the robot.
        spacing: ring: all look at the middle. row: each overlaps with its neighbours only. apart:
            no two of the fixed ones see the same floor.
        clocks: alike: all exact and of one rate. free: each with its own offset, drift and rate.
        robot: The last one drives.
        model: Image and rate.
        rng: Random numbers.
    """
    fixed = count - robot
    poses = _ring(fixed, rng) if spacing.layout == "ring" else _row(fixed, spacing, rng)
    cameras = [_camera(k, pose, clocks, model, rng) for k, pose in enumerate(poses)]
    floor = _floor(fixed, spacing)
    if robot:
        cameras.append(_robot(len(cameras), floor, clocks, model, rng))
    return LayoutPlan(tuple(cameras), floor)


def _ring(count: int, rng: np.random.Generator) -> list[tuple[float, float, float]]:
    """Return x, y and yaw in degrees of each camera."""
    radius_m = _radius_m(count)
    poses = []
    for k in range(count):
        angle = 2 * math.pi * (k + rng.uniform(-0.15, 0.15)) / count
        yaw_deg = math.degrees(angle) + 180 + rng.uniform(-8, 8)
        poses.append((radius_m * math.cos(angle), radius_m * math.sin(angle), yaw_deg))
    return poses


def _row(
    count: int, spacing: Spacing, rng: np.random.Generator
) -> list[tuple[float, float, float]]:
    step_m = spacing.step_m(count)
    return [
        ((k - (count - 1) / 2) * step_m, rng.uniform(-0.1, 0.1), 90 + rng.uniform(-2, 2))
        for k in range(count)
    ]


def _radius_m(count: int) -> float:
    return RING_M + RING_GROWTH_M * max(count - 4, 0)


def _floor(count: int, spacing: Spacing) -> Floor:
    if spacing.layout == "ring":
        side_m = _radius_m(count) - INSIDE_M
        return (-side_m, -side_m), (side_m, side_m)
    half_m = (count - 1) / 2 * spacing.step_m(count) + 1.2
    return (-half_m, NEAR_M), (half_m, FAR_M[count > 4])


def _camera(
    number: int,
    pose: tuple[float, float, float],
    clocks: Clocks,
    model: CameraModel,
    rng: np.random.Generator,
) -> CameraPlan:
    fps = RATES_HZ[number % len(RATES_HZ)] if clocks == "free" else model.fps
    # The clock of the first camera is the reference of the others.
    free = clocks == "free" and number > 0
    phase, offset, drift = rng.uniform((0, -1, -1), (1, 1, 1)).tolist()
    return CameraPlan(
        name=f"c{number + 1}",
        at=(*pose[:2], float(rng.uniform(*HEIGHTS_M))),
        yaw_deg=pose[2],
        pitch_deg=float(rng.uniform(*PITCHES_DEG)),
        roll_deg=float(rng.uniform(-3, 3)),
        avoided=False,
        width=model.width,
        height=model.height,
        focal_px=model.focal_px,
        fps=fps,
        phase_s=phase * 0.99 / fps,
        clock_offset_s=OFFSET_S * offset if free else 0.0,
        clock_drift_ppm=DRIFT_PPM * drift if free else 0.0,
        image=model.image,
        depth_sensor=model.depth_sensor,
    )


def _robot(
    number: int, floor: Floor, clocks: Clocks, model: CameraModel, rng: np.random.Generator
) -> CameraPlan:
    """Return a camera that drives to and fro along the left edge of the floor, and turns."""
    (left, low), (_, high) = floor
    plan = _camera(number, (left + 0.3, (low + high) / 2, 0.0), clocks, model, rng)
    pieces = (
        Drive(for_s=DRIVE_S, speed_mps=DRIVE_MPS, turn_dps=TURN_DPS / 4),
        Drive(for_s=DRIVE_S, speed_mps=-DRIVE_MPS, turn_dps=-TURN_DPS / 4),
        Drive(for_s=DRIVE_S / 2, turn_dps=-TURN_DPS),
        Drive(for_s=DRIVE_S / 2, turn_dps=TURN_DPS),
    )
    rounds = math.ceil(model.duration_s / sum(piece.for_s for piece in pieces))
    values = {field: getattr(plan, field) for field in plan.__struct_fields__}
    values |= {"name": "robot", "at": (*plan.at[:2], 1.15), "pitch_deg": 3.0, "roll_deg": 0.0}
    return CameraPlan(**{**values, "drive": pieces * rounds, "avoided": False})
