"""Visible share of each person in the virtual lab, from outlines, without rendering."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lab.scenario import Scenario
from lab.truth.motion_capture import capture, person_id
from lab.truth.silhouette import silhouettes
from lab.world import EPOCH_NS, World
from people4d.errors import SourceError
from people4d.messages import F64

SAME_MOTION_M = 0.1  # [m] maximum distance of truth and simulation of the same motion
CHECKS = 5  # number of stamps at which the distance is checked


@dataclass(frozen=True)
class SimulatedView:
    """View of the camera at one stamp."""

    shares: Mapping[str, float]  # visible share of the body by identity
    map_from_camera: F64  # 4x4


def simulated_views(
    scenario: Scenario,
    seed: int | None,
    positions_m: Sequence[Mapping[str, F64]],
    stamps_ns: Sequence[int],
) -> list[SimulatedView] | None:
    """Return the camera's view of a rendered scenario at the stamp of each frame.

    None if the recorded positions differ from the present scenario.
    """
    world = World(scenario, seed)
    number = {person_id(k): k for k in range(len(scenario.people))}
    for row in np.linspace(0, len(stamps_ns) - 1, CHECKS).astype(int).tolist():
        for name, position_m in positions_m[row].items():
            if name not in number:
                return None
            now = capture(world, number[name], _seconds(stamps_ns[row])).position_m
            if np.linalg.norm(now - position_m) > SAME_MOTION_M:
                return None
    return [_view(world, _seconds(stamp_ns)) for stamp_ns in stamps_ns]


def save_views(path: Path, stamps_ns: Sequence[int], views: Sequence[SimulatedView]) -> None:
    """Write views to a file; SourceError if the file cannot be written."""
    ids = list(dict.fromkeys(name for view in views for name in view.shares))
    shares = [[view.shares[name] for name in ids] for view in views]
    poses = [view.map_from_camera for view in views]
    new = path.with_suffix(f".{os.getpid()}.npz")
    try:
        np.savez(new, stamps_ns=stamps_ns, ids=ids, shares=shares, map_from_camera=poses)
        new.replace(path)
    except OSError as error:
        raise SourceError(f"{path} cannot be written: {error.strerror}") from error


def load_views(path: Path, stamps_ns: Sequence[int]) -> list[SimulatedView] | None:
    """Return the views in a file; None if it is absent or has other stamps."""
    if not path.is_file():
        return None
    with np.load(path, allow_pickle=False) as file:
        if file["stamps_ns"].tolist() != list(stamps_ns):
            return None
        rows = zip(file["shares"].tolist(), file["map_from_camera"], strict=True)
        ids = file["ids"].tolist()
        return [SimulatedView(dict(zip(ids, row, strict=True)), pose) for row, pose in rows]


def _view(world: World, t_s: float) -> SimulatedView:
    people = world.keypoints_m(t_s)
    found = silhouettes(people, world.optical_from_map(t_s), world.info)
    shares = {
        person_id(k): found[k].visible_share if k in found else 0.0 for k in range(len(people))
    }
    return SimulatedView(shares, world.map_from_optical(t_s))


def _seconds(stamp_ns: int) -> float:
    return (stamp_ns - EPOCH_NS) / 1e9
