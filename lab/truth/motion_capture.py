"""Ground truth of the people of a scenario, as published by a motion-capture system."""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from common.geometry.transforms import wrap
from lab.scenario import CapturePlan
from lab.world import World, stamp_ns
from people4d.messages import F64, Truth, TruthPerson

NOISE_KEY = 9101  # key of the random numbers
TORSO = [5, 6, 11, 12]  # shoulders and hips in COCO order
STEP_S = 0.01  # half the interval of the numerical derivative [s]


@dataclass(frozen=True)
class Capture:
    """True state of one person at one time; frame: map."""

    position_m: F64  # 3, torso = mean of both shoulders and both hips
    yaw_rad: float  # yaw of the chest
    path_yaw_rad: float  # yaw of the path


def capture(world: World, person: int, t_s: float) -> Capture:
    """Return the true state of a person, counted from 0, at a time."""
    body, motion = world.bodies[person], world.motions[person]
    pose = motion.at(t_s)
    return Capture(
        position_m=body.keypoints_m(pose)[TORSO].mean(axis=0),
        yaw_rad=body.chest_yaw(pose),
        path_yaw_rad=wrap(motion.path_yaw(t_s)),
    )


def velocity_mps(world: World, person: int, t_s: float) -> F64:
    """Return the velocity of a person's torso."""
    before, after = (capture(world, person, t_s + step).position_m for step in (-STEP_S, STEP_S))
    return np.asarray((after - before) / (2 * STEP_S))


def person_id(person: int) -> str:
    """Return the identity of a person, counted from 0: the number that owns their pixels."""
    return str(person + 1)


def capture_truth(world: World) -> Iterator[Truth]:
    """Yield the messages of motion capture, from the start to the end of the scenario.

    Velocities are derivatives of the true positions, since a capture system smooths positions.
    """
    plan, people = world.scenario.capture, len(world.scenario.people)
    errors = [np.random.default_rng([world.seed, NOISE_KEY, k]) for k in range(people)]
    recent = [deque[Capture](maxlen=3) for _ in range(people)]
    for sequence in range(-2, int(world.scenario.duration_s * plan.rate_hz + 1e-9) + 1):
        for k, samples in enumerate(recent):
            samples.append(capture(world, k, (sequence + 1) / plan.rate_hz))
        if sequence < 0:
            continue
        t_s = sequence / plan.rate_hz
        yield Truth(
            stamp_ns=stamp_ns(t_s),
            sequence=sequence,
            frame_id="map",
            people=tuple(_measure(person_id(k), recent[k], plan, errors[k]) for k in range(people)),
        )


def _measure(
    identity: str, samples: Sequence[Capture], plan: CapturePlan, rng: np.random.Generator
) -> TruthPerson:
    """Return a person as captured at the middle one of three samples."""
    before, now, after = samples
    return TruthPerson(
        id=identity,
        position_m=now.position_m + plan.noise_m * rng.standard_normal(3),
        velocity_mps=(after.position_m - before.position_m) * (plan.rate_hz / 2),
        yaw_rad=wrap(now.yaw_rad + math.radians(plan.yaw_noise_deg) * rng.standard_normal()),
        path_yaw_rad=now.path_yaw_rad,
    )


@dataclass(frozen=True)
class Footfall:
    """Contact of a foot with the floor."""

    time_s: float  # time since the start of the scenario
    side: int  # index of the side: 0 left, 1 right
    position_m: F64  # 2, x and y of the ankle in the stance, frame: map


def footfalls(world: World, person: int) -> list[Footfall]:
    """Return the footfalls of a person during the scenario, in order."""
    duration_s = world.scenario.duration_s
    found = [
        Footfall(float(down_s), side, footprint[:2])
        for side, foot in enumerate(world.motions[person].feet)
        for down_s, footprint in zip(foot.down_s, foot.footprint, strict=True)
        if 0 <= down_s <= duration_s
    ]
    return sorted(found, key=lambda footfall: footfall.time_s)
