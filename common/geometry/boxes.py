"""Boxes in the image: xyxy is left, top, right, bottom in pixels."""

import numpy as np
import numpy.typing as npt

from people4d.messages import F64


def intersections_xyxy(a: npt.ArrayLike, b: npt.ArrayLike) -> F64:
    """Return the areas (NxM, px^2) of the intersections of Nx4 and Mx4 boxes."""
    a = np.asarray(a, np.float64).reshape(-1, 1, 4)
    b = np.asarray(b, np.float64).reshape(1, -1, 4)
    sides = np.minimum(a[..., 2:], b[..., 2:]) - np.maximum(a[..., :2], b[..., :2])
    return np.asarray(np.prod(np.maximum(sides, 0.0), axis=-1))


def iou_xyxy(a: npt.ArrayLike, b: npt.ArrayLike) -> F64:
    """Return the intersection over union (NxM, 0 if empty) of Nx4 and Mx4 boxes."""
    a = np.asarray(a, np.float64).reshape(-1, 1, 4)
    b = np.asarray(b, np.float64).reshape(1, -1, 4)
    overlap = intersections_xyxy(a, b)
    area_a = np.prod(np.maximum(a[..., 2:] - a[..., :2], 0.0), axis=-1)
    area_b = np.prod(np.maximum(b[..., 2:] - b[..., :2], 0.0), axis=-1)
    union = area_a + area_b - overlap
    iou: F64 = np.divide(overlap, union, out=np.zeros_like(overlap), where=union > 0)
    return iou


def nms(boxes: npt.ArrayLike, scores: npt.ArrayLike, iou_max: float) -> list[int]:
    """Return the boxes (indices of Nx4) after non-maximum suppression, best score first."""
    overlap = iou_xyxy(boxes, boxes)
    selected: list[int] = []
    for index in np.argsort(-np.asarray(scores, np.float64), kind="stable"):
        if not selected or overlap[index, selected].max() <= iou_max:
            selected.append(int(index))
    return selected
