"""Measurements and configurations for tests of trackers."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace

from common.config import load
from common.geometry.transforms import LINK_FROM_OPTICAL
from people4d.messages import F64
from services.presets import preset_settings
from services.tracker.config import TrackerConfig
from services.tracker.interface import Measurement, Observation
from services.tracker.strongsort3d.config import StrongSort3dConfig

FRAME_NS = 100_000_000
FOCAL_PX = 600.0
AT_REST = np.zeros(3)
RED, BLUE = (1.0, 0.1, 0.0), (0.0, 0.1, 1.0)  # cosine distance 0.99


def person(
    x: float, y: float, index: int = 0, score: float = 0.9, embedding: Sequence[float] | None = None
) -> Measurement:
    """A person 1.7 m tall and 0.5 m wide, seen from the origin of the map along +x."""
    u, v = 320.0 - FOCAL_PX * y / x, 240.0
    half_width, half_height = FOCAL_PX * 0.25 / x, FOCAL_PX * 0.85 / x
    return Measurement(
        index=index,
        box_xyxy_px=np.array([u - half_width, v - half_height, u + half_width, v + half_height]),
        score=score,
        position_m=np.array([x, y, 1.0]),
        forward_m=x,
        embedding=None if embedding is None else unit(embedding),
    )


def facing(
    yaw_rad: float | None, sigma_rad: float | None = None, x: float = 3.0, y: float = 0.0
) -> Measurement:
    """A person with a yaw."""
    return dataclasses.replace(person(x, y), yaw_rad=yaw_rad, yaw_sigma_rad=sigma_rad)


def unit(vector: Sequence[float]) -> F64:
    values = np.asarray(vector, np.float64)
    return values / np.linalg.norm(values)


def frame(number: int, *people: Measurement, camera: str = "camera") -> Observation:
    """Frame 0, 1, 2, ... of ten a second."""
    return Observation(
        stamp_ns=number * FRAME_NS, measurements=people, camera=camera, embedder="histogram"
    )


def with_pose(number: int, *people: Measurement) -> Observation:
    """A frame of a camera at the origin of the map that looks along +x."""
    observation = frame(number, *people)
    return dataclasses.replace(observation, map_from_camera=LINK_FROM_OPTICAL, size_px=(640, 480))


def published(**constants: Any) -> StrongSort3dConfig:
    """StrongSORT-3D with the published constants, without policies."""
    settings = [text.partition(".") for text in preset_settings("seg-strongsort")]
    overrides = [field for service, _, field in settings if service == "tracker"]
    tracker = load(TrackerConfig, "tracker", overrides=overrides, environment={})
    return replace(tracker.strongsort3d, **constants)


def published_config(**fields: Any) -> TrackerConfig:
    """A tracker with the published constants."""
    return replace(TrackerConfig(yaw="velocity", strongsort3d=published()), **fields)
