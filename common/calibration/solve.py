"""Calibration of several cameras: all steps, and the reasons to refuse."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from common.calibration.adjustment import AdjustmentResult, CameraPose, adjust
from common.calibration.graph import GraphResult, Pair, is_ambiguous, solve_graph
from common.calibration.level import Uprightness, level_from_optical, torso_heights_m, uprightness
from common.calibration.level_paths import LevelPaths
from common.calibration.observations import CameraObservations
from common.calibration.pairs import PairResult, match_pair
from common.calibration.tracklets import Tracklet, tracklets
from people4d.errors import CalibrationError
from people4d.messages import F64

SEARCH_S = 1.0  # by which clocks may differ from what times of arrival say
WALK_M = 1.0  # extent of a path of a person who walks
PEOPLE_MIN = 30  # positions of people in a camera
HEIGHTS_MIN = 20  # people with ankles in view, for the height of the floor
TORSO_M = 1.08  # height of a torso over the floor where no ankles are in view
RMS_MAX_M = 0.2  # of the distances of one person's positions by two cameras
SIGMA_MAX_M, SIGMA_MAX_RAD = 0.04, 0.0175  # of a pose that is sure enough
SCALE_MAX, SCALE_SIGMAS = 0.04, 4.0  # change of scale that right intrinsics do not need
WALK_HINT = "Let one or two people walk about in curves, for a minute, in view of two cameras each."


@dataclass(frozen=True)
class CalibrationResult:
    """Poses and clocks of all cameras."""

    reference: str  # camera whose clock is that of all
    map_from_camera: Mapping[str, F64]  # 4x4, optical frame, by camera
    poses: Mapping[str, CameraPose]  # in the optical frame of the reference
    adjustment: AdjustmentResult
    contradicting: Sequence[Pair]  # pairs that were left out
    frames: Mapping[str, str]  # optical frame by camera
    floor_people: int  # on whose feet the height of the floor rests; 0: on usual statures
    paths_m: Mapping[str, Sequence[F64]]  # Nx3 each, of all people by camera, frame: map


def calibrate(
    observed: Sequence[CameraObservations],
    reference: str = "",
    map_from_reference: F64 | None = None,
    search_s: float = SEARCH_S,
) -> CalibrationResult:
    """Return the poses and clocks of cameras from the people who walked before them.

    Args:
        observed: What each camera saw.
        reference: Camera that is the origin; empty: the first by name.
        map_from_reference: Its pose (4x4); None: the map is on the floor below it, x forward.
        search_s: Largest offset of clocks beyond what times of arrival say.

    Raises:
        CalibrationError: The people do not determine the poses; says what is missing.
    """
    names = [c.camera for c in observed]
    reference = reference or min(names, default="")
    _check_cameras(observed, reference)
    origin_ns = {c.camera: _origin_ns(c, observed) for c in observed}
    paths = {c.camera: tracklets(c.frames, origin_ns[c.camera]) for c in observed}
    _check_walks(observed, paths)
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
    _check_graph(names, pairs, graph)
    adjustment = adjust(cameras, graph.poses, reference)
    _check_adjustment(adjustment, reference)
    poses = {
        name: _with_clock(pose, origin_ns[name] - origin_ns[reference])
        for name, pose in adjustment.poses.items()
    }
    from_reference, floor_people = _map_from_reference(observed, poses, upright)
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
    """Return the stamp of grid step 0: the same time of arrival for all cameras."""
    assert camera.delay_ns is not None
    first = observed[0]
    assert first.delay_ns is not None
    return first.frames[0].stamp_ns + first.delay_ns - camera.delay_ns


def _with_clock(pose: CameraPose, origin_ns: int) -> CameraPose:
    """Return a pose whose offset is that of the stamps."""
    values = {field: getattr(pose, field) for field in pose.__dataclass_fields__}
    return CameraPose(**{**values, "offset_s": pose.offset_s + origin_ns / 1e9})


def _uprightness(camera: CameraObservations, paths: Sequence[Tracklet]) -> Uprightness:
    return uprightness([p for frame in camera.frames for p in frame.people], paths)


def _map_from_reference(
    observed: Sequence[CameraObservations],
    poses: Mapping[str, CameraPose],
    upright: Mapping[str, Uprightness],
) -> tuple[F64, int]:
    """Return the reference's pose above the floor, x forward, and the people it rests on."""
    up = Uprightness.total(
        upright[name].turned(pose.matrix[:3, :3]) for name, pose in poses.items()
    ).up()
    torsos, floors = list[float](), list[F64]()
    for camera in observed:
        matrix = poses[camera.camera].matrix
        people = [p for frame in camera.frames for p in frame.people]
        people = people[:: max(len(people) // 2000, 1)]
        own_up = matrix[:3, :3].T @ up
        footed = [p for p in people if p.low_ray is not None and p.is_low_ankle]
        heights = torso_heights_m(footed, own_up)
        levels = np.array([(matrix[:3, :3] @ p.position_m + matrix[:3, 3]) @ up for p in people])
        torsos += levels.tolist()
        if len(heights) == len(footed) and len(footed):
            at = np.array([(matrix[:3, :3] @ p.position_m + matrix[:3, 3]) @ up for p in footed])
            floors.append(at - heights)
    found = np.concatenate(floors) if floors else np.zeros(0)
    enough = len(found) >= HEIGHTS_MIN
    floor_m = float(np.median(found)) if enough else float(np.median(torsos)) - TORSO_M
    matrix = np.eye(4)
    matrix[:3, :3] = level_from_optical(up)
    matrix[2, 3] = -floor_m
    return matrix, len(found) if enough else 0


def _check_cameras(observed: Sequence[CameraObservations], reference: str) -> None:
    names = ", ".join(c.camera for c in observed)
    if len(observed) < 2:
        heard = f"only {names} sends detections" if observed else "no camera sends detections"
        raise CalibrationError(f"expected two cameras or more, {heard}", "Start the others, too.")
    if reference not in [c.camera for c in observed]:
        raise CalibrationError(f"there is no camera {reference}", f"There are {names}.")
    several = [c.camera for c in observed if c.is_of_several]
    if several:
        raise CalibrationError(
            f"two cameras or robots call themselves {_these(several)}: their frames are mixed",
            "Give each camera of the site a name of its own: camera.camera.",
        )
    empty = [c.camera for c in observed if c.people < PEOPLE_MIN]
    if empty:
        raise CalibrationError(
            f"{_these(empty)} saw people for less than {PEOPLE_MIN} frames", WALK_HINT
        )
    without = [c.camera for c in observed if c.info is None]
    if without:
        raise CalibrationError(
            f"the intrinsics of {_these(without)} are not known", "See CameraInfo in the messages."
        )


def _check_walks(
    observed: Sequence[CameraObservations], paths: Mapping[str, Sequence[Tracklet]]
) -> None:
    still = [
        c.camera
        for c in observed
        if max((path.extent_m for path in paths[c.camera]), default=0.0) < WALK_M
    ]
    if still:
        raise CalibrationError(f"no person walked before {_these(still)}", WALK_HINT)


def _check_graph(
    names: Sequence[str], pairs: Mapping[Pair, PairResult], graph: GraphResult
) -> None:
    missing = sorted(set(names) - set(graph.poses))
    if not missing:
        return
    linked = sorted(graph.poses)
    unsure = [pair for pair in graph.ambiguous if set(pair) & set(missing)]
    if unsure:
        a, b = unsure[0]
        raise CalibrationError(
            f"the walks before {a} and {b} fit in two ways",
            f"One person alone walks in curves between {a} and {b}: walks that are straight, or "
            "mirror each other, do not show which is which.",
        )
    seconds = {
        pair: result.best.matched / 10 if result.best and not is_ambiguous(result) else 0.0
        for pair, result in pairs.items()
        if len(set(pair) & set(missing)) == 1
    }
    a, b = max(seconds, key=lambda pair: seconds[pair])
    raise CalibrationError(
        f"{_these(missing)} shared no person with {_these(linked)} for long enough",
        f"Walk between {a} and {b}.",
    )


def _check_adjustment(adjustment: AdjustmentResult, reference: str) -> None:
    if adjustment.rms_m > RMS_MAX_M:
        raise CalibrationError(
            f"positions of one person differ by {adjustment.rms_m:.2f} m from camera to camera",
            "Depth or intrinsics of a camera are wrong, or the cameras moved. " + WALK_HINT,
        )
    wrong = {
        name: (axis, scale, abs(scale - 1) / max(sigma, 1e-9))
        for name, pose in adjustment.poses.items()
        for axis, scale, sigma in zip(
            ("focal length", "depth"), pose.scales, pose.scale_sigmas, strict=True
        )
        if abs(scale - 1) > SCALE_MAX and abs(scale - 1) > SCALE_SIGMAS * sigma
    }
    if wrong:
        name = max(wrong, key=lambda n: abs(wrong[n][1] - 1))
        axis, scale, _ = wrong[name]
        raise CalibrationError(
            f"the intrinsics of {name} do not fit: positions are {abs(scale - 1):.0%} too "
            f"{'small' if scale > 1 else 'large'} by its {axis}",
            f"Compare the calibration of {name} with its image size, and its unit of depth.",
        )
    unsure = {
        name: pose
        for name, pose in adjustment.poses.items()
        if name != reference and (pose.sigma_m > SIGMA_MAX_M or pose.sigma_rad > SIGMA_MAX_RAD)
    }
    if unsure:
        name, pose = max(unsure.items(), key=lambda item: item[1].sigma_m)
        seconds = {pair: s for pair, s in adjustment.pair_seconds.items() if name in pair}
        near = max(seconds, key=lambda pair: seconds[pair], default=(name, reference))
        other = near[0] if near[1] == name else near[1]
        raise CalibrationError(
            f"the pose of {name} is not sure: {100 * pose.sigma_m:.1f} cm, "
            f"{np.degrees(pose.sigma_rad):.1f} deg",
            f"Walk longer, and in curves, between {name} and {other}.",
        )


def _these(names: Sequence[str]) -> str:
    return ", ".join(names[:-1]) + " and " + names[-1] if len(names) > 1 else names[0]
