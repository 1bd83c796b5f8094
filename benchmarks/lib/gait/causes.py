"""First stage that loses an annotated step of a real person."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from people4d.messages import CameraInfo
from services.gait.estimator import GaitFrame, GaitResult
from services.gait.points.keypoints import (
    HEAD,
    JOINTS,
    KEYPOINT_CONFIDENCE_MIN,
    LEFT_FOOT,
    RIGHT_FOOT,
    pixels_of,
)
from services.gait.steps.steps import Side

Run = Sequence[tuple[CameraInfo, GaitFrame, Sequence[GaitResult]]]
# Stages in the order of processing, with the failure of each
STAGES: Mapping[str, str] = {
    "track": "no published person is at the annotated one",
    "keypoint": "no keypoint of the ankle has a confidence of 0.4 or more",
    "one leg": "keypoints of both ankles are within 0.10 m of each other in the image",
    "depth": "no depth at the keypoint is within 0.5 m of the person's",
    "heading": "the yaw differs from the motion by more than 60°",
    "point": "the foot is not measured",
    "time base": "the step is found only if the same points are spread to 4 Hz",
    "steps": "the foot is measured, and no step is found",
}
KEYPOINT_STAGES = ("track", "keypoint", "one leg", "depth")
AROUND = 1  # Maximum distance of the examined frames from the landing [frames]
SAME_LEG_M, BODY_M = 0.10, 0.5  # Distances of ankles from each other, and of depth from the body
DEPTH_PX = 4  # Radius about a keypoint that is searched for depth [px]
YAW_RAD, MOVED_M = np.pi / 3, 0.15  # Maximum error of yaw, minimum motion over three frames


@dataclass(frozen=True)
class Scene:
    """Results of all frames, and the person of each track and frame."""

    run: Run
    owner: Mapping[tuple[int, int], str]


def first_loss(scene: Scene, person: str, at: float, foot: Side) -> str:
    """Return the first stage that fails in all frames about a landing; "steps" if none does."""
    frames = range(max(round(at) - AROUND, 0), min(round(at) + AROUND + 1, len(scene.run)))
    here = [
        (index, one)
        for index in frames
        for one in scene.run[index][2]
        if scene.owner.get((one.person.id, index)) == person
    ]
    passed = [_keypoint_stages(*scene.run[index][:2], one, foot) for index, one in here]
    depth = max(
        (flags.index(False) if False in flags else len(flags) for flags in passed), default=0
    )
    if depth < len(KEYPOINT_STAGES):
        return KEYPOINT_STAGES[depth]
    if any(_contradicts_motion(scene, one.person.id, index) for index, one in here):
        return "heading"
    states = [p.state for _, one in here for p in one.person.points if p.name == f"{foot}_foot"]
    return "steps" if "measured" in states else "point"


def _keypoint_stages(
    info: CameraInfo, frame: GaitFrame, result: GaitResult, foot: Side
) -> list[bool]:
    """Return the success of each of KEYPOINT_STAGES in one frame."""
    one = next((o for o in frame.observations if o.id == result.person.id), None)
    if one is None or one.keypoints is None or one.depth_m is None:
        return [True, False]
    left, right = (one.keypoints[JOINTS[name][0]] for name in (LEFT_FOOT, RIGHT_FOOT))
    own = left if foot == "left" else right
    apart_px = float(np.linalg.norm(left[:2] - right[:2]))
    u, v = np.rint(own[:2]).astype(int)
    rows, columns = (slice(max(x - DEPTH_PX, 0), max(x + DEPTH_PX + 1, 0)) for x in (v, u))
    depth_m = frame.depth_mm[rows, columns] / 1000
    return [
        True,
        bool(own[2] >= KEYPOINT_CONFIDENCE_MIN),
        apart_px >= pixels_of(SAME_LEG_M, one.depth_m, info),
        bool(((depth_m > 0) & (np.abs(depth_m - one.depth_m) < BODY_M)).any()),
    ]


def _contradicts_motion(scene: Scene, key: int, index: int) -> bool:
    """Check that the yaw of a moving person contradicts the motion of the head."""
    yaw_rad = next((o.yaw_rad for o in scene.run[index][1].observations if o.id == key), None)
    heads_m = [
        point.position_m[:2]
        for _, _, results in scene.run[max(index - 1, 0) : index + 2]
        for one in results
        for point in one.person.points
        if one.person.id == key and point.name == HEAD and point.state == "measured"
    ]
    if yaw_rad is None or len(heads_m) < 2:
        return False
    moved_m = heads_m[-1] - heads_m[0]
    length_m = float(np.linalg.norm(moved_m))
    along_m = float(moved_m @ (np.cos(yaw_rad), np.sin(yaw_rad)))
    return length_m > MOVED_M and along_m < np.cos(YAW_RAD) * length_m
