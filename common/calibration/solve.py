"""Calibration of several cameras: all steps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from common.calibration.adjustment import AdjustmentResult, CameraPose, adjust
from common.calibration.checks import check_adjustment, check_cameras, check_graph, check_walks
from common.calibration.floor import MeasuredFloor, find_floor
from common.calibration.graph import Pair, solve_graph
from common.calibration.level import Uprightness, level_from_optical, torso_heights_m, uprightness
from common.calibration.level_paths import LevelPaths
from common.calibration.observations import CameraObservations
from common.calibration.pairs import match_pair
from common.calibration.tracklets import Tracklet, tracklets
from common.geometry.transforms import apply, transform_from
from people4d.messages import F64

SEARCH_S = 1.0  # [s] maximum offset of clocks beyond the times of arrival
HEIGHTS_MIN = 20  # minimum number of people with visible ankles for the height of the floor
TORSO_M = 1.08  # [m] height of a torso above the floor if no ankles are in view


@dataclass(frozen=True)
class CalibrationResult:
    """Poses and clocks of all cameras."""

    reference: str  # camera that defines the origin and the clock
    map_from_camera: Mapping[str, F64]  # 4x4, optical frame, by camera
    poses: Mapping[str, CameraPose]  # poses in the optical frame of the reference, by camera
    adjustment: AdjustmentResult
    contradicting: Sequence[Pair]  # pairs that were excluded
    frames: Mapping[str, str]  # optical frame by camera
    # Number of people whose feet determine the floor; 0: depth or mean statures determine it
    floor_people: int
    paths_m: Mapping[str, Sequence[F64]]  # Nx3, paths of all people by camera, frame: map


def calibrate(
    observed: Sequence[CameraObservations],
    reference: str = "",
    map_from_reference: F64 | None = None,
    search_s: float = SEARCH_S,
) -> CalibrationResult:
    """Return the poses and clocks of cameras from walking people in view.

    CalibrationError if the people do not determine the poses.

    Args:
        observed: Observations of each camera.
        reference: Camera that is the origin; empty: the first by name.
        map_from_reference: Pose of the reference (4x4); None: the map is on the floor below it, x
            forward.
        search_s: Maximum offset of clocks beyond the times of arrival [s].
    """
    names = [c.camera for c in observed]
    reference = reference or min(names, default="")
    check_cameras(observed, reference)
    origin_ns = {c.camera: _origin_ns(c, observed) for c in observed}
    paths = {c.camera: tracklets(c.frames, origin_ns[c.camera]) for c in observed}
    check_walks(observed, paths)
    upright = {c.camera: _uprightness(c, paths[c.camera]) for c in observed}
    cameras = {
        c.camera: LevelPaths(
            c.camera, level_from_optical(upright[c.camera].up()), c.info, paths[c.camera]
        )
        for c in observed
    }
    pairs = {
        (a, b): match_pair(cameras[a], cameras[b], 0.0, search_s)
        for a, b in combinations(sorted(names), 2)
    }
    graph = solve_graph(cameras, pairs, reference)
    check_graph(names, pairs, graph)
    floors = {c.camera: f for c in observed if (f := _floor(c, upright[c.camera].up()))}
    adjustment = adjust(cameras, graph.poses, reference, floors)
    check_adjustment(adjustment, reference)
    poses = {
        name: replace(pose, offset_s=pose.offset_s + (origin_ns[name] - origin_ns[reference]) / 1e9)
        for name, pose in adjustment.poses.items()
    }
    from_reference, floor_people = _map_from_reference(observed, adjustment.floor, poses, upright)
    if map_from_reference is not None:
        from_reference = map_from_reference
    map_from = {name: from_reference @ pose.matrix for name, pose in poses.items()}
    return CalibrationResult(
        reference=reference,
        map_from_camera=map_from,
        poses=poses,
        adjustment=adjustment,
        contradicting=graph.contradicting,
        frames={c.camera: c.frame_id for c in observed},
        floor_people=floor_people,
        paths_m={
            name: [t.positions_m @ map_from[name][:3, :3].T + map_from[name][:3, 3] for t in made]
            for name, made in paths.items()
        },
    )


def _origin_ns(camera: CameraObservations, observed: Sequence[CameraObservations]) -> int:
    """Return the stamp of grid step 0, which has the same time of arrival for all cameras."""
    assert camera.delay_ns is not None
    first = observed[0]
    assert first.delay_ns is not None
    return first.frames[0].stamp_ns + first.delay_ns - camera.delay_ns


def _uprightness(camera: CameraObservations, paths: Sequence[Tracklet]) -> Uprightness:
    return uprightness([p for frame in camera.frames for p in frame.people], paths)


def _floor(camera: CameraObservations, up: F64) -> MeasuredFloor | None:
    """Return the floor in view of a camera from depth, at the feet of people."""
    levels, floors = _levels_m(camera, np.eye(4), up)
    if camera.info is None or not camera.depths_mm:
        return None
    floor_m = _floor_m(floors, levels)
    return find_floor(list(camera.depths_mm), camera.info, up, -floor_m)


def _map_from_reference(
    observed: Sequence[CameraObservations],
    floor: MeasuredFloor | None,
    poses: Mapping[str, CameraPose],
    upright: Mapping[str, Uprightness],
) -> tuple[F64, int]:
    """Return the reference's pose above the floor, x forward, and the number of people used."""
    if floor is not None:
        return _above(floor.up, -floor.camera_m), 0
    up = Uprightness.total(
        upright[name].turned(pose.matrix[:3, :3]) for name, pose in poses.items()
    ).up()
    found = [_levels_m(camera, poses[camera.camera].matrix, up) for camera in observed]
    levels, floors = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return _above(up, _floor_m(floors, levels)), len(floors) if len(floors) >= HEIGHTS_MIN else 0


def _above(up: F64, floor_m: float) -> F64:
    """Return the pose of a camera in a map on the floor below it."""
    return transform_from((0.0, 0.0, -floor_m), level_from_optical(up))


def _floor_m(floors_m: F64, torsos_m: F64) -> float:
    """Return the level of the floor from feet, or from mean statures."""
    if len(floors_m) >= HEIGHTS_MIN:
        return float(np.median(floors_m))
    return float(np.median(torsos_m)) - TORSO_M


def _levels_m(camera: CameraObservations, matrix: F64, up: F64) -> tuple[F64, F64]:
    """Return the levels of torsos, and of the floor at people's feet, in another frame."""
    people = [p for frame in camera.frames for p in frame.people]
    people = people[:: max(len(people) // 2000, 1)]
    footed = [p for p in people if p.low_ray is not None and p.is_low_ankle]
    heights = torso_heights_m(footed, matrix[:3, :3].T @ up)
    levels, at = (
        apply(matrix, np.array([p.position_m for p in some]).reshape(-1, 3)) @ up
        for some in (people, footed)
    )
    return levels, at - heights if len(heights) == len(footed) else np.zeros(0)
