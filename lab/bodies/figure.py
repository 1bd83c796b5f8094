"""Baked bodies: shapes without clothes, and their bones."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lab.drawing.mesh import I32
from people4d.messages import F64

ASSET = Path(__file__).parents[1] / "assets" / "bodies.npz"
NOSE, EYE, EAR = 0, 1, 3  # nose, left eye and left ear in COCO order


@dataclass(frozen=True)
class Figure:
    """Body in the neutral pose, pelvis frame, with the helper meshes of clothes."""

    vertices_m: F64  # Vx3
    weights: F64  # VxB shares of the bones, rows sum to 1
    bones: tuple[str, ...]  # B names
    faces: dict[str, I32]  # triangles of each part: body, tights, skirt, hair, eyes
    masks: dict[str, F64]  # V, membership in regions of the skin, 0 to 1: lips, ears, eyelids
    joints_m: dict[str, F64]  # joint -> 2x3 (left, right) or 3
    # 17xBx4; a keypoint is the sum over bones of map_from_rest (3x4) @ form (4)
    keypoint_forms: F64


@cache
def arrays() -> dict[str, npt.NDArray[np.generic]]:
    """Return the arrays of the asset, see scripts/bake_bodies."""
    with np.load(ASSET) as asset:
        return {key: asset[key] for key in asset.files}


def load_figure(name: str) -> Figure:
    """Return the figure of a name; ValueError if there is no such figure."""
    asset = arrays()
    person = [str(figure) for figure in asset["people"]].index(name)
    steps = asset["vertices"].astype(np.float64)
    own = steps[0] + (steps[person] if person else 0.0)
    bones = tuple(str(bone) for bone in asset["bone_names"])
    weights = np.zeros((len(own), len(bones)))
    shares = asset["vertex_shares"].astype(np.float64) / 255
    np.put_along_axis(weights, asset["vertex_bones"].astype(np.int64), shares, axis=1)
    # Forms are stored with half precision; the parts of a point must sum to 1.
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


def scaled(figure: Figure, size: float) -> Figure:
    """Return a figure with another stature, relative to the figure, and the same proportions."""
    if size == 1.0:
        return figure
    forms = figure.keypoint_forms.copy()
    forms[:, :, :3] *= size
    return replace(
        figure,
        vertices_m=figure.vertices_m * size,
        joints_m={name: joint * size for name, joint in figure.joints_m.items()},
        keypoint_forms=forms,
    )


@dataclass(frozen=True)
class HeadLandmarks:
    """Landmarks of a head in the neutral pose, pelvis frame."""

    nose: F64  # [m] 3, tip of the nose
    eye: F64  # [m] 3, left eye
    ear: F64  # [m] 3, left ear
    mouth: F64  # [m] 3, middle of the lips
    unit_m: float  # height of the crown above the eyes, the unit of head coordinates

    def coordinates(self, vertices_m: F64) -> tuple[F64, F64, F64]:
        """Return head coordinates: forward of the ears, off the middle, above the eyes."""
        x, y, z = vertices_m.T
        return (
            (x - self.ear[0]) / self.unit_m,
            np.abs(y) / self.unit_m,
            (z - self.eye[2]) / self.unit_m,
        )

    def position_m(self, before: npt.ArrayLike, left: npt.ArrayLike, above: npt.ArrayLike) -> F64:
        """Return the positions of head coordinates [m], Nx3, left positive."""
        units = np.stack(np.broadcast_arrays(before, left, above), axis=-1) * self.unit_m
        return np.asarray(units + np.array([self.ear[0], 0.0, self.eye[2]]))


def find_head(figure: Figure) -> HeadLandmarks:
    """Return the landmarks of a figure's head."""
    keypoints = figure.keypoint_forms[:, :, :3].sum(axis=1)
    body = np.unique(figure.faces["body"])
    lips = body[figure.masks["lips"][body] > 0.5]
    return HeadLandmarks(
        nose=keypoints[NOSE],
        eye=keypoints[EYE],
        ear=keypoints[EAR],
        mouth=figure.vertices_m[lips].mean(axis=0),
        unit_m=float(figure.vertices_m[body][:, 2].max() - keypoints[EYE][2]),
    )


def on_head(figure: Figure) -> npt.NDArray[np.bool_]:
    """Return the mask of vertices that move with head or neck."""
    columns = [figure.bones.index(name) for name in ("neck", "head")]
    share: npt.NDArray[np.bool_] = figure.weights[:, columns].sum(axis=1) > 0.5
    return share
