"""Pose graph of cameras: first poses from the best pairs, and the pairs that contradict them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from common.calibration.level_paths import LevelPaths
from common.calibration.pairs import LevelPose, PairResult

MATCHED_MIN = 40  # minimum number of matched positions that link two cameras: 4 s
AMBIGUOUS = 0.75  # minimum ratio of the score of an equally good pose to the best score
# Maximum difference of a pair from the other poses [m, rad, s]
LOOP_M, LOOP_RAD, LOOP_S = 0.5, 0.2, 0.25

Pair = tuple[str, str]


@dataclass(frozen=True)
class GraphResult:
    """Poses of all cameras that are linked to the reference."""

    poses: Mapping[str, LevelPose]  # poses by camera, in the level frame of the reference
    contradicting: Sequence[Pair]  # pairs inconsistent with the poses
    ambiguous: Sequence[Pair]  # pairs with two equally good poses, undecided by other pairs


def is_ambiguous(result: PairResult) -> bool:
    """Check that a pair has two distinct solutions."""
    best, second = result.best, result.second
    return best is not None and second is not None and second.score > AMBIGUOUS * best.score


def solve_graph(
    cameras: Mapping[str, LevelPaths], pairs: Mapping[Pair, PairResult], reference: str
) -> GraphResult:
    """Return the poses along the strongest pairs; an ambiguous pair links nothing.

    Args:
        cameras: Paths by name.
        pairs: Results by names of two cameras, a and b.
        reference: Camera whose level frame is the frame of the poses.
    """
    usable = {
        pair: result.best
        for pair, result in pairs.items()
        if result.best is not None and result.best.matched >= MATCHED_MIN and result.best.score > 0
    }
    decided = {pair: pose for pair, pose in usable.items() if not is_ambiguous(pairs[pair])}
    poses = {reference: LevelPose(0.0, np.zeros(3), 0.0)}
    while True:
        edges = [
            (pose.score, pair, pose)
            for pair, pose in decided.items()
            if (pair[0] in poses) != (pair[1] in poses)
        ]
        if not edges:
            break
        _, (one, other), pose = max(edges, key=lambda edge: edge[0])
        if one in poses:
            poses[other] = joined(poses[one], pose)
        else:
            poses[one] = joined(poses[other], inverse(pose))
    contradicting = [
        (a, b)
        for (a, b), pose in decided.items()
        if a in poses and not agrees(pose, joined(inverse(poses[a]), poses[b]), cameras[b])
    ]
    ambiguous = [
        pair
        for pair in usable
        if pair not in decided and not (pair[0] in poses and pair[1] in poses)
    ]
    return GraphResult(poses, contradicting, ambiguous)


def joined(first: LevelPose, then: LevelPose) -> LevelPose:
    """Return the pose of c in a from the poses of b in a and c in b."""
    return LevelPose(
        first.yaw_rad + then.yaw_rad,
        first.apply(then.translation_m),
        first.offset_s + then.offset_s,
    )


def inverse(pose: LevelPose) -> LevelPose:
    """Return the pose of a in b."""
    return LevelPose(-pose.yaw_rad, -(pose.translation_m @ pose.rotation), -pose.offset_s)


def agrees(pose: LevelPose, expected: LevelPose, b: LevelPaths) -> bool:
    """Check that two poses of camera b map its people to similar positions and times."""
    middle = np.nanmean(b.positions_m, axis=(0, 1))
    turned = (pose.yaw_rad - expected.yaw_rad + np.pi) % (2 * np.pi) - np.pi
    moved = float(np.linalg.norm(pose.apply(middle) - expected.apply(middle)))
    late = abs(pose.offset_s - expected.offset_s)
    return bool(moved < LOOP_M and abs(turned) < LOOP_RAD and late < LOOP_S)
