"""BVH files of walks, read again by forward kinematics."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deploy.exporters.bvh import TREE, bvh
from evaluation.gait.motion import JointMotion
from people4d.messages import F64
from people4d.messages.skeleton import JOINTS

LENGTHS_M = {"knee": 0.42, "ankle": 0.4, "elbow": 0.3, "wrist": 0.25, "neck": 0.5, "ears": 0.2}
FRAMES = 12
ENDS = {
    **{f"end of {side}_knee": f"{side}_ankle" for side in ("left", "right")},
    **{f"end of {side}_elbow": f"{side}_wrist" for side in ("left", "right")},
    "end of head": "left_ear",
}


@pytest.fixture
def motion() -> JointMotion:
    """Return joints of a skeleton with constant bones in random poses, z up."""
    rng = np.random.default_rng(5)

    def bone(length_m: float) -> F64:
        vectors = rng.normal(size=(FRAMES, 3))
        return np.asarray(length_m * vectors / np.linalg.norm(vectors, axis=1, keepdims=True))

    hips_m = np.array((2.0, -1.0, 0.9)) + rng.normal(0, 0.2, (FRAMES, 3))
    neck_m = hips_m + bone(LENGTHS_M["neck"])
    at = dict.fromkeys(JOINTS, neck_m)
    for middle_m, names in (
        (hips_m, ("hip", "knee", "ankle")),
        (neck_m, ("shoulder", "elbow", "wrist")),
    ):
        across_m = bone(0.15)
        for side, sign in (("left", 1), ("right", -1)):
            at[f"{side}_{names[0]}"] = middle_m + sign * across_m
            for before, name in pairwise(names):
                at[f"{side}_{name}"] = at[f"{side}_{before}"] + bone(LENGTHS_M[name])
    at["left_ear"] = at["right_ear"] = neck_m + bone(LENGTHS_M["ears"])
    return JointMotion(0.0, 20.0, np.stack([at[name] for name in JOINTS], axis=1))


def wanted_cm(motion: JointMotion, name: str) -> F64:
    """Return the joint of a motion, y up."""
    return np.asarray(100 * motion.joints_m[:, JOINTS.index(name)][:, (0, 2, 1)] * (1, 1, -1))


def positions_cm(text: str) -> dict[str, F64]:
    """Return the positions of all joints by forward kinematics; end sites by their parents."""
    lines = [line.split() for line in text.splitlines()]
    begin = lines.index(["MOTION"])
    rows = np.array(lines[begin + 3 :], np.float64)
    assert rows.shape == (int(lines[begin + 1][1]), 3 + 3 * 12)
    path, column, found = list[tuple[F64, Rotation]](), 0, dict[str, F64]()
    here_cm, turned, name = np.zeros(3), Rotation.identity(), ""
    for line in lines[1:begin]:
        if line[0] in ("ROOT", "JOINT", "End"):
            name = f"end of {name}" if line[0] == "End" else line[1]
        elif line[0] == "{":
            path.append((here_cm, turned))
        elif line[0] == "}":
            here_cm, turned = path.pop()
        elif line[0] == "OFFSET":
            here_cm = found[name] = here_cm + turned.apply(np.array(line[1:], np.float64))
        elif line[0] == "CHANNELS":
            if line[2] == "Xposition":
                here_cm, column = rows[:, :3], 3
                found[name] = here_cm
            turned = turned * Rotation.from_euler("ZXY", rows[:, column : column + 3], degrees=True)
            column += 3
    return found


def test_forward_kinematics_give_the_joints(motion: JointMotion) -> None:
    found = positions_cm(bvh(motion))
    assert len(found) == len(TREE)
    for name, at_cm in found.items():
        joint = ENDS.get(name, name)
        if joint in JOINTS:
            np.testing.assert_allclose(at_cm, wanted_cm(motion, joint), atol=0.02, err_msg=name)
    hips_cm = (wanted_cm(motion, "left_hip") + wanted_cm(motion, "right_hip")) / 2
    np.testing.assert_allclose(found["hips"], hips_cm, atol=0.02)


def test_unknown_joint_is_interpolated_and_unseen_bone_has_no_length(motion: JointMotion) -> None:
    joints_m = motion.joints_m.copy()
    joints_m[4, JOINTS.index("left_hip")] = np.nan
    joints_m[:, JOINTS.index("right_ankle")] = np.nan
    text = bvh(JointMotion(0.0, 20.0, joints_m))
    found = positions_cm(text)
    hips_cm = (wanted_cm(motion, "left_hip")[3] + wanted_cm(motion, "left_hip")[5]) / 2
    hips_cm = (hips_cm + wanted_cm(motion, "right_hip")[4]) / 2
    np.testing.assert_allclose(found["hips"][4], hips_cm, atol=0.02)
    np.testing.assert_allclose(found["end of right_knee"], found["right_knee"], atol=0.02)
    assert "nan" not in text


def test_person_without_positions_stands_at_the_origin() -> None:
    found = positions_cm(bvh(JointMotion(0.0, 20.0, np.full((3, len(JOINTS), 3), np.nan))))
    assert not any(at_cm.any() for at_cm in found.values())


def test_file_is_read_by_bvhio(motion: JointMotion, tmp_path: Path) -> None:
    bvhio = pytest.importorskip("bvhio")
    path = tmp_path / "walk.bvh"
    path.write_text(bvh(motion))
    read = bvhio.readAsHierarchy(str(path))
    for frame in range(FRAMES):
        read.loadPose(frame)
        for name in ("left_hip", "right_knee", "left_shoulder", "right_elbow"):
            (joint,) = read.filter(name, isEqual=True)
            expected = wanted_cm(motion, name)[frame]
            np.testing.assert_allclose(list(joint.PositionWorld), expected, atol=0.02)
