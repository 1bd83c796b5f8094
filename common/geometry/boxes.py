"""Boxes in the image: xyxy is left, top, right, bottom in pixels."""

import numpy as np
import numpy.typing as npt

from people4d.messages import F64


def intersections_xyxy(a: npt.ArrayLike, b: npt.ArrayLike) -> F64:
    """Return the areas (NxM, px^2) of the intersections of Nx4 and Mx4 boxes."""
    a = np.asarray(a, np.float64).reshape(-1, 1, 4)
    b = np.asarray(b, np.float64).reshape(1, -1, 4)
    return _areas(np.maximum(a[..., :2], b[..., :2]), np.minimum(a[..., 2:], b[..., 2:]))


def iou_xyxy(a: npt.ArrayLike, b: npt.ArrayLike) -> F64:
    """Return the intersection over union (NxM, 0 if empty) of Nx4 and Mx4 boxes."""
    a = np.asarray(a, np.float64).reshape(-1, 1, 4)
    b = np.asarray(b, np.float64).reshape(1, -1, 4)
    overlap = intersections_xyxy(a, b)
    union = _areas(a[..., :2], a[..., 2:]) + _areas(b[..., :2], b[..., 2:]) - overlap
    iou: F64 = np.divide(overlap, union, out=np.zeros_like(overlap), where=union > 0)
    return iou


def _areas(first: F64, last: F64) -> F64:
    """Return the areas between corners (...x2), 0 if empty."""
    sides = np.maximum(last - first, 0.0)
    areas: F64 = sides[..., 0] * sides[..., 1]
    return areas


def nms(boxes: npt.ArrayLike, scores: npt.ArrayLike, iou_max: float) -> list[int]:
    """Return the boxes (indices of Nx4) after non-maximum suppression, best score first."""
    overlap = iou_xyxy(boxes, boxes)
    selected: list[int] = []
    for index in np.argsort(-np.asarray(scores, np.float64), kind="stable"):
        if not selected or overlap[index, selected].max() <= iou_max:
            selected.append(int(index))
    return selected
