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


def middle_cm(motion: JointMotion, name: str) -> F64:
    """Return the middle of the left and the right joint of a motion, y up."""
    return (wanted_cm(motion, f"left_{name}") + wanted_cm(motion, f"right_{name}")) / 2


def without(motion: JointMotion, *names: str) -> JointMotion:
    """Return a motion in which some joints are unknown in all frames."""
    joints_m = motion.joints_m.copy()
    joints_m[:, [JOINTS.index(name) for name in names]] = np.nan
    return JointMotion(motion.start_s, motion.rate_hz, joints_m)


def lengths_cm(text: str) -> dict[str, float]:
    """Return the distance of each joint from its parent."""
    offsets = [line.split()[1:] for line in text.splitlines() if "OFFSET" in line]
    lengths = np.linalg.norm(np.array(offsets, np.float64), axis=1).tolist()
    return dict(zip(TREE, lengths, strict=True))


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
    np.testing.assert_allclose(found["hips"], middle_cm(motion, "hip"), atol=0.02)


def test_unknown_joint_is_interpolated_and_unseen_bone_has_no_length(motion: JointMotion) -> None:
    part = without(motion, "right_ankle")
    part.joints_m[4, JOINTS.index("left_hip")] = np.nan
    text = bvh(part)
    found = positions_cm(text)
    hips_cm = (wanted_cm(motion, "left_hip")[3] + wanted_cm(motion, "left_hip")[5]) / 2
    hips_cm = (hips_cm + wanted_cm(motion, "right_hip")[4]) / 2
    np.testing.assert_allclose(found["hips"][4], hips_cm, atol=0.02)
    np.testing.assert_allclose(found["end of right_knee"], found["right_knee"], atol=0.02)
    assert "nan" not in text


def test_known_hip_is_the_root_if_the_other_one_is_unknown(motion: JointMotion) -> None:
    text = bvh(without(motion, "right_hip"))
    hip_cm, neck_cm = wanted_cm(motion, "left_hip"), middle_cm(motion, "shoulder")
    np.testing.assert_allclose(positions_cm(text)["hips"], hip_cm, atol=0.02)
    expected_cm = np.linalg.norm(neck_cm - hip_cm, axis=1).mean()
    assert lengths_cm(text)["neck"] == pytest.approx(expected_cm, abs=0.01)
    assert max(lengths_cm(text).values()) < 80


def test_root_turns_with_the_shoulders_if_a_hip_is_unknown(motion: JointMotion) -> None:
    text = bvh(without(motion, "right_hip"))
    rows = np.array([line.split() for line in text.splitlines()[-FRAMES:]], np.float64)
    root = Rotation.from_euler("ZXY", rows[:, 3:6], degrees=True)
    across_cm = wanted_cm(motion, "right_shoulder") - wanted_cm(motion, "left_shoulder")
    expected = across_cm / np.linalg.norm(across_cm, axis=1, keepdims=True)
    np.testing.assert_allclose(root.apply((0, 0, 1)), expected, atol=1e-4)


def test_known_shoulder_is_the_neck_if_the_other_one_is_unknown(motion: JointMotion) -> None:
    lengths = lengths_cm(bvh(without(motion, "right_shoulder")))
    to_cm = wanted_cm(motion, "left_shoulder") - middle_cm(motion, "hip")
    expected_cm = np.linalg.norm(to_cm, axis=1).mean()
    assert lengths["neck"] == pytest.approx(expected_cm, abs=0.01)
    assert lengths["left_shoulder"] == lengths["right_shoulder"] == 0
    assert max(lengths.values()) < 80


def test_known_ear_is_the_end_of_the_head(motion: JointMotion) -> None:
    found = positions_cm(bvh(without(motion, "right_ear")))
    np.testing.assert_allclose(found["end of head"], wanted_cm(motion, "left_ear"), atol=0.02)


@pytest.mark.parametrize("unknown", [(), ("right_shoulder",), ("right_knee",)])
def test_root_without_hips_is_halfway_from_shoulders_to_knees(
    motion: JointMotion, unknown: tuple[str, ...]
) -> None:
    text = bvh(without(motion, "left_hip", "right_hip", *unknown))
    ends_cm = [
        wanted_cm(motion, f"left_{name}") if f"right_{name}" in unknown else middle_cm(motion, name)
        for name in ("shoulder", "knee")
    ]
    np.testing.assert_allclose(positions_cm(text)["hips"], sum(ends_cm) / 2, atol=0.02)
    assert max(lengths_cm(text).values()) < 80


def test_root_without_hips_and_knees_is_between_the_shoulders(motion: JointMotion) -> None:
    text = bvh(without(motion, "left_hip", "right_hip", "left_knee", "right_knee"))
    np.testing.assert_allclose(positions_cm(text)["hips"], middle_cm(motion, "shoulder"), atol=0.02)


def test_root_without_hips_shoulders_and_knees_is_the_mean_of_the_known_joints(
    motion: JointMotion,
) -> None:
    known = ("left_wrist", "right_ankle")
    text = bvh(without(motion, *(name for name in JOINTS if name not in known)))
    expected_cm = sum(wanted_cm(motion, name) for name in known) / 2
    np.testing.assert_allclose(positions_cm(text)["hips"], expected_cm, atol=0.02)


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
