"""Worlds shared by several tests, built once, and the people in view."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from common.geometry.transforms import apply
from lab.catalogue import load_scenario
from lab.world import World
from people4d.messages import F64

BODY_RADIUS_M = 0.22


@cache
def world(name: str) -> World:
    """Return the world of a shipped scenario."""
    return World(load_scenario(name))


@dataclass(frozen=True)
class Watch:
    """People as upright cylinders before the camera; arrays are TxK.

    Args:
        in_view: True if the middle is in the image and nearer than 5 m.
        hidden: Maximum share of the width occluded by one other person.
    """

    in_view: npt.NDArray[np.bool_]
    hidden: F64


@cache
def watch(of: World, step_s: float) -> Watch:
    """Return the people in view of a world in steps of time."""
    t_s = np.arange(0, of.scenario.duration_s, step_s)
    positions = np.stack([motion.path(t_s)[:, :2] for motion in of.motions], axis=1)
    points = np.concatenate([positions, np.ones((*positions.shape[:2], 1))], axis=-1)
    in_camera = np.stack(
        [apply(of.optical_from_map(t), p) for t, p in zip(t_s.tolist(), points, strict=True)]
    )
    x, z = in_camera[..., 0], in_camera[..., 2]
    half_width = of.info.width / 2 / of.info.fx
    in_view = (z > 0.5) & (z < of.info.max_depth_m) & (np.abs(x / z) < half_width)
    bearing, distance = np.arctan2(x, z), np.hypot(x, z)
    half = np.arcsin(np.minimum(BODY_RADIUS_M / distance, 0.9))
    low, high = bearing - half, bearing + half
    # Axes: time, occluded person, occluder
    overlap = np.minimum(high[:, :, None], high[:, None]) - np.maximum(
        low[:, :, None], low[:, None]
    )
    nearer = (distance[:, None] < distance[:, :, None]) & (z > 0.5)[:, None]
    share = np.where(nearer, np.maximum(overlap, 0), 0) / (2 * half[:, :, None])
    return Watch(in_view, np.minimum(share.max(axis=-1), 1.0))
