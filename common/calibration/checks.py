"""Reasons to refuse a calibration, with their remedies."""

from collections.abc import Mapping, Sequence

import numpy as np

from common.calibration.adjustment import AdjustmentResult
from common.calibration.graph import GraphResult, Pair, is_ambiguous
from common.calibration.observations import CameraObservations
from common.calibration.pairs import PairResult
from common.calibration.tracklets import Tracklet
from people4d.errors import CalibrationError

WALK_M = 1.0  # minimum extent of the path of a walking person [m]
PEOPLE_MIN = 30  # minimum number of positions of people in a camera
RMS_MAX_M = 0.2  # maximum RMS distance between positions of one person by two cameras [m]
SIGMA_MAX_M, SIGMA_MAX_RAD = 0.04, 0.0175  # maximum standard deviation of an accepted pose [m, rad]
SCALE_MAX, SCALE_SIGMAS = 0.04, 4.0  # maximum change of scale for correct intrinsics
WALK_HINT = "Let one or two people walk about in curves, for a minute, in view of two cameras each."


def check_cameras(observed: Sequence[CameraObservations], reference: str) -> None:
    """Check that cameras have unique names, intrinsics and people."""
    names = ", ".join(c.camera for c in observed)
    if len(observed) < 2:
        heard = f"only {names} sends detections" if observed else "no camera sends detections"
        raise CalibrationError(f"expected two cameras or more, {heard}", "Start the others, too.")
    if reference not in [c.camera for c in observed]:
        raise CalibrationError(f"unknown camera {reference}", f"Known cameras: {names}.")
    several = [c.camera for c in observed if c.is_of_several]
    if several:
        raise CalibrationError(
            f"two cameras or robots are named {_these(several)}: their frames are mixed",
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


def check_walks(
    observed: Sequence[CameraObservations], paths: Mapping[str, Sequence[Tracklet]]
) -> None:
    """Check that people walked in view of each camera."""
    still = [
        c.camera
        for c in observed
        if max((path.extent_m for path in paths[c.camera]), default=0.0) < WALK_M
    ]
    if still:
        raise CalibrationError(f"no person walked before {_these(still)}", WALK_HINT)


def check_graph(names: Sequence[str], pairs: Mapping[Pair, PairResult], graph: GraphResult) -> None:
    """Check that all cameras are linked."""
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


def check_adjustment(adjustment: AdjustmentResult, reference: str) -> None:
    """Check the accuracy of poses, and the intrinsics."""
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
            f"the pose of {name} is too uncertain: {100 * pose.sigma_m:.1f} cm, "
            f"{np.degrees(pose.sigma_rad):.1f} deg",
            f"Walk longer, and in curves, between {name} and {other}.",
        )


def _these(names: Sequence[str]) -> str:
    return ", ".join(names[:-1]) + " and " + names[-1] if len(names) > 1 else names[0]
