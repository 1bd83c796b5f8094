"""Coordinates of a head, in which hair and face are described once for all people."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lab.bodies.figure import Figure
from people4d.messages import F64

NOSE, EYE, EAR = 0, 1, 3  # COCO; of the pairs the left


@dataclass(frozen=True)
class Head:
    """Landmarks of a head in the neutral posture, pelvis frame.

    Args:
        nose: 3, its tip, in metres.
        eye: 3, the left one.
        ear: 3, the left one.
        mouth: 3, middle of the lips.
        unit_m: From the eyes' height to the crown.
    """

    nose: F64
    eye: F64
    ear: F64
    mouth: F64
    unit_m: float

    def coordinates(self, vertices_m: F64) -> tuple[F64, F64, F64]:
        """Return how far vertices lie before the ears, beside the middle, above the eyes; units."""
        x, y, z = vertices_m.T
        return (
            (x - self.ear[0]) / self.unit_m,
            np.abs(y) / self.unit_m,
            (z - self.eye[2]) / self.unit_m,
        )

    def place_m(self, before: npt.ArrayLike, left: npt.ArrayLike, above: npt.ArrayLike) -> F64:
        """Return the vertices at these coordinates, left positive; Nx3."""
        units = np.stack(np.broadcast_arrays(before, left, above), axis=-1) * self.unit_m
        places: F64 = units + np.array([self.ear[0], 0.0, self.eye[2]])
        return places


def find_head(figure: Figure) -> Head:
    """Return the head of a figure."""
    keypoints = figure.keypoint_forms[:, :, :3].sum(axis=1)
    body = np.unique(figure.faces["body"])
    lips = body[figure.masks["lips"][body] > 0.5]
    return Head(
        nose=keypoints[NOSE],
        eye=keypoints[EYE],
        ear=keypoints[EAR],
        mouth=figure.vertices_m[lips].mean(axis=0),
        unit_m=float(figure.vertices_m[body][:, 2].max() - keypoints[EYE][2]),
    )


def on_head(figure: Figure) -> npt.NDArray[np.bool_]:
    """Return which vertices move with head or neck rather than with the trunk."""
    columns = [figure.bones.index(name) for name in ("neck", "head")]
    share: npt.NDArray[np.bool_] = figure.weights[:, columns].sum(axis=1) > 0.5
    return share
