"""The baked bodies: shapes without clothes, and the bones that move them."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lab.drawing.mesh import I32
from people4d.messages import F64

ASSET = Path(__file__).parents[1] / "assets" / "bodies.npz"


@dataclass(frozen=True)
class Figure:
    """A body in the neutral posture, pelvis frame, and the helper meshes that clothes follow.

    Args:
        vertices_m: Vx3.
        weights: VxB shares of the bones, rows sum to 1.
        bones: B names.
        faces: Triangles of each part: body, tights, skirt, hair, eyes.
        masks: How far vertices belong to regions of the skin, 0 to 1: lips, ears, eyelids.
        joints_m: Joint -> 2x3 (left, right) or 3.
        keypoint_forms: 17xBx4; a keypoint is the sum over bones of map_from_rest (3x4) @ form (4).
    """

    vertices_m: F64
    weights: F64
    bones: tuple[str, ...]
    faces: dict[str, I32]
    masks: dict[str, F64]
    joints_m: dict[str, F64]
    keypoint_forms: F64


@cache
def arrays() -> dict[str, npt.NDArray[np.generic]]:
    """Return the arrays of the asset, see scripts/bake_bodies."""
    with np.load(ASSET) as asset:
        return {key: asset[key] for key in asset.files}


def figure_names() -> list[str]:
    """Return the names of all figures."""
    return [str(name) for name in arrays()["people"]]


def load_figure(name: str) -> Figure:
    """Return the figure of that name.

    Raises:
        ValueError: There is none.
    """
    asset, person = arrays(), figure_names().index(name)
    steps = asset["vertices"].astype(np.float64)
    own = steps[0] + (steps[person] if person else 0.0)
    bones = tuple(str(bone) for bone in asset["bone_names"])
    weights = np.zeros((len(own), len(bones)))
    shares = asset["vertex_shares"].astype(np.float64) / 255
    np.put_along_axis(weights, asset["vertex_bones"].astype(np.int64), shares, axis=1)
    # Half the digits are stored; the parts of a point must sum to 1 all the same.
    forms = asset["keypoint_forms"][person].astype(np.float64)
    prefixed = {
        kind: {
            key.removeprefix(kind): value for key, value in asset.items() if key.startswith(kind)
        }
        for kind in ("faces_", "joint_", "mask_")
    }
    return Figure(
        vertices_m=own * float(asset["step_m"].astype(np.float64)),
        weights=weights,
        bones=bones,
        faces={key: value.astype(np.int32) for key, value in prefixed["faces_"].items()},
        masks={key: value.astype(np.float64) / 255 for key, value in prefixed["mask_"].items()},
        joints_m={
            key: value[person].astype(np.float64) for key, value in prefixed["joint_"].items()
        },
        keypoint_forms=forms / forms[:, :, 3].sum(axis=1)[:, None, None],
    )
