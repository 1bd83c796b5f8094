"""Faults of odometry, by name."""

import math
from collections.abc import Callable
from dataclasses import replace

import msgspec
import numpy as np

from benchmarks.lib.odometry.rides import Sample

Fault = Callable[[tuple[Sample, ...]], tuple[Sample, ...]]


def frozen(samples: tuple[Sample, ...]) -> tuple[Sample, ...]:
    """Repeat one pose during the middle third."""
    first, last = len(samples) // 3, 2 * len(samples) // 3
    held = samples[first].odometry
    return (
        *samples[:first],
        *(_changed(s, theta_rad=held.theta_rad) for s in samples[first:last]),
        *samples[last:],
    )


def silent(samples: tuple[Sample, ...]) -> tuple[Sample, ...]:
    """Drop the middle third."""
    return samples[: len(samples) // 3] + samples[2 * len(samples) // 3 :]


def lossy(samples: tuple[Sample, ...]) -> tuple[Sample, ...]:
    """Drop one sample of ten."""
    received = np.random.default_rng(1).random(len(samples)) >= 0.1
    return tuple(sample for sample, there in zip(samples, received, strict=True) if there)


def late(samples: tuple[Sample, ...]) -> tuple[Sample, ...]:
    """Delay all samples by 200 ms."""
    return tuple(replace(s, arrival_ns=s.arrival_ns + 200_000_000) for s in samples)


def slipping(samples: tuple[Sample, ...]) -> tuple[Sample, ...]:
    """Scale turns by a factor of 1 +- 0.3 (one sigma) that changes every second."""
    rng, published = np.random.default_rng(2), []
    factors = 1 + 0.3 * rng.standard_normal(1 + len(samples))
    before = theta_rad = samples[0].odometry.theta_rad
    for sample in samples:
        step = math.remainder(sample.odometry.theta_rad - before, 2 * math.pi)
        before = sample.odometry.theta_rad
        second = (sample.odometry.stamp_ns - samples[0].odometry.stamp_ns) // 1_000_000_000
        theta_rad += step * factors[second]
        published.append(_changed(sample, theta_rad=math.remainder(theta_rad, 2 * math.pi)))
    return tuple(published)


def offset(samples: tuple[Sample, ...]) -> tuple[Sample, ...]:
    """Set the robot's clock 100 ms ahead of the camera's."""
    return tuple(_changed(s, stamp_ns=s.odometry.stamp_ns + 100_000_000) for s in samples)


def restarted(samples: tuple[Sample, ...]) -> tuple[Sample, ...]:
    """Restart the odometry at yaw 0 in the middle."""
    half = len(samples) // 2
    zero = samples[half].odometry.theta_rad
    after = (
        _changed(s, theta_rad=math.remainder(s.odometry.theta_rad - zero, 2 * math.pi))
        for s in samples[half:]
    )
    return (*samples[:half], *after)


def _changed(sample: Sample, **fields: float) -> Sample:
    return replace(sample, odometry=msgspec.structs.replace(sample.odometry, **fields))


FAULTS: dict[str, Fault] = {
    "none": lambda samples: samples,
    "frozen for a third of the time": frozen,
    "silent for a third of the time": silent,
    "10 % lost": lossy,
    "200 ms late": late,
    "wheels slip (30 % of the turn, changing every second)": slipping,
    "clock 100 ms ahead": offset,
    "restarts in the middle": restarted,
}
