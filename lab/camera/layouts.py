"""Layouts of several cameras: fixed cameras with their own rates and clocks, and one on a robot."""

import math

import numpy as np
from msgspec.structs import replace

from lab.camera.plan import CameraPlan, Drive
from lab.random_options import RandomScene

Floor = tuple[tuple[float, float], tuple[float, float]]  # [m] lower and upper corner, frame: map
Pose = tuple[float, float, float]  # x and y [m], yaw [deg], frame: map

RING_M = 3.6  # radius of a ring of up to four cameras [m]
RING_GROWTH_M = 0.35  # growth of the radius with each camera above four [m]
APART_M = 6.0  # distance of neighbours without a common view [m]
INSIDE_M = 0.8  # minimum distance of people from a ring of cameras [m]
LENGTH_M = 21.6  # maximum length of a row [m]
NEAR_M, FAR_M = 1.6, (4.4, 3.5)  # nearest floor before a row; farthest, for up to four and more [m]
HEIGHTS_M, PITCHES_DEG = (2.0, 2.4), (14.0, 22.0)
RATES_HZ = (10.0, 15.0, 12.5, 15.0, 7.5, 15.0)  # frame rates with free clocks, by camera [Hz]
OFFSET_S, DRIFT_PPM = 0.3, 60.0  # maximum offset and drift of free clocks
DRIVE_MPS, DRIVE_S, TURN_DPS = 0.25, 6.0, 12.0


def lay_out(
    options: RandomScene, model: CameraPlan, rng: np.random.Generator
) -> tuple[tuple[CameraPlan, ...], Floor]:
    """Return cameras about the origin, named c1, c2, ... and `robot`, and the floor in their view.

    Args:
        options: Number of cameras, layout and clocks.
        model: Image and rate of each camera.
        rng: Random numbers.
    """
    fixed = options.cameras - options.robot
    poses = _ring(fixed, rng) if options.layout == "ring" else _row(fixed, options, rng)
    cameras = [_camera(k, pose, options, model, rng) for k, pose in enumerate(poses)]
    floor = _floor(fixed, options)
    if options.robot:
        cameras.append(_robot(floor, options, model, rng))
    return tuple(cameras), floor


def _ring(count: int, rng: np.random.Generator) -> list[Pose]:
    radius_m = _radius_m(count)
    poses = []
    for k in range(count):
        angle = 2 * math.pi * (k + rng.uniform(-0.15, 0.15)) / count
        yaw_deg = math.degrees(angle) + 180 + rng.uniform(-8, 8)
        poses.append((radius_m * math.cos(angle), radius_m * math.sin(angle), yaw_deg))
    return poses


def _row(count: int, options: RandomScene, rng: np.random.Generator) -> list[Pose]:
    step_m = _step_m(count, options)
    return [
        ((k - (count - 1) / 2) * step_m, rng.uniform(-0.1, 0.1), 90 + rng.uniform(-2, 2))
        for k in range(count)
    ]


def _radius_m(count: int) -> float:
    return RING_M + RING_GROWTH_M * max(count - 4, 0)


def _step_m(count: int, options: RandomScene) -> float:
    """Return the distance of neighbours in a row."""
    apart_m = min(APART_M, LENGTH_M / max(count - 1, 1))
    return options.row_m if options.layout == "row" else apart_m


def _floor(count: int, options: RandomScene) -> Floor:
    if options.layout == "ring":
        side_m = _radius_m(count) - INSIDE_M
        return (-side_m, -side_m), (side_m, side_m)
    half_m = (count - 1) / 2 * _step_m(count, options) + 1.2
    return (-half_m, NEAR_M), (half_m, FAR_M[count > 4])


def _camera(
    number: int, pose: Pose, options: RandomScene, model: CameraPlan, rng: np.random.Generator
) -> CameraPlan:
    free = options.clocks == "free"
    fps = RATES_HZ[number % len(RATES_HZ)] if free else model.fps
    # The clock of the first camera is the reference of the others.
    wrong = free and number > 0
    phase, offset, drift = rng.uniform((0, -1, -1), (1, 1, 1)).tolist()
    return replace(
        model,
        name=f"c{number + 1}",
        at=(*pose[:2], float(rng.uniform(*HEIGHTS_M))),
        yaw_deg=pose[2],
        pitch_deg=float(rng.uniform(*PITCHES_DEG)),
        roll_deg=float(rng.uniform(-3, 3)),
        fps=fps,
        phase_s=phase * 0.99 / fps,
        clock_offset_s=OFFSET_S * offset if wrong else 0.0,
        clock_drift_ppm=DRIFT_PPM * drift if wrong else 0.0,
    )


def _robot(
    floor: Floor, options: RandomScene, model: CameraPlan, rng: np.random.Generator
) -> CameraPlan:
    """Return a camera that drives back and forth along the left edge of the floor, and turns."""
    (left, low), (_, high) = floor
    pose = (left + 0.3, (low + high) / 2, 0.0)
    plan = _camera(options.cameras - 1, pose, options, model, rng)
    pieces = (
        Drive(for_s=DRIVE_S, speed_mps=DRIVE_MPS, turn_dps=TURN_DPS / 4),
        Drive(for_s=DRIVE_S, speed_mps=-DRIVE_MPS, turn_dps=-TURN_DPS / 4),
        Drive(for_s=DRIVE_S / 2, turn_dps=-TURN_DPS),
        Drive(for_s=DRIVE_S / 2, turn_dps=TURN_DPS),
    )
    drive = pieces * math.ceil(options.duration_s / sum(piece.for_s for piece in pieces))
    at = (*plan.at[:2], 1.15)
    return replace(plan, name="robot", at=at, pitch_deg=3.0, roll_deg=0.0, drive=drive)
