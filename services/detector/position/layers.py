"""Assignment of people to layers of depth, with occluders in front and a wall behind.

Depth samples at many points of a person show several layers. The person's layer has most samples
and agrees with the size in the image: an occluder is nearer, and would need an implausibly small
torso to appear as large. Samples in other layers or on another person do not count: of two
overlapping people, the better score is in front (docs/method.md section 10).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from people4d.messages import F64
from services.detector.position.proportions import BodySize
from services.detector.position.surface import Flags, Indices

# Maximum distance of a reading from the middle of its layer, and an allowance for rounding [m]
HALF_M = 0.25 + 1e-9
SIZE_SIGMA = 0.2  # standard deviation of the logarithm of people's sizes
MISFIT = 0.02  # minimum weight of a possible layer by the person's size
LARGER_MAX = 2.0  # maximum size of a person, relative to the mean
SMALLER_MAX = 2.2  # ratio of the mean to the minimum height of a torso
# Minimum score of a person's layer, reached with a quarter of the samples of a person of half the
# mean size
SCORE_MIN = 0.005


@dataclass(frozen=True, slots=True)
class DepthSamples:
    """First readings of depth on one person."""

    pixels: F64  # [px] Nx2, points on the person
    depth_m: F64  # [m] N, NaN if unread
    weights: F64  # N, 1 on the torso
    size: BodySize | None = None  # None: unknown
    crown_px: tuple[float, float] | None = None  # [px] top of the person; None: unknown
    margin_px: float = 0.0  # [px] margin of the outline beyond the points and the crown
    cut_off: bool = False  # True if one side of the image cuts the person off


@dataclass(frozen=True, slots=True)
class PersonLayer:
    """Layer of depth of a person."""

    depth_m: float  # [m] middle of the layer
    own: Flags  # N, samples not covered by other people


class _Choice(NamedTuple):
    """Best layer of a person's own samples."""

    depth_m: float  # [m] NaN where the score is 0
    score: float  # 0 to 1


NO_LAYER = _Choice(math.nan, 0.0)


def assign_layers(people: Sequence[DepthSamples]) -> list[PersonLayer | None]:
    """Return the layer of each person of a frame, None if it has no own samples.

    People are assigned in the order of their scores, people of unknown size last. Samples on a
    person with a layer do not count for others.
    """
    layers: list[PersonLayer | None] = [None] * len(people)
    finite = [np.isfinite(person.depth_m) for person in people]
    alone = [_best_layer(*one) for one in zip(people, finite, strict=True)]
    order = sorted(range(len(people)), key=lambda k: (people[k].size is None, -alone[k].score))
    for rank, k in enumerate(order):
        own = finite[k]
        for other in order[:rank]:
            layer = layers[other]
            if layer is not None:
                own = own & ~(own & _on(people[k], people[other], layer))
        is_alone = own is finite[k] or np.array_equal(own, finite[k])
        best = alone[k] if is_alone else _best_layer(people[k], own)
        if best.score > 0:
            layers[k] = PersonLayer(best.depth_m, own)
    return layers


def _best_layer(person: DepthSamples, own: Flags) -> _Choice:
    """Return the best layer of a person's own samples.

    The score is 0 if no layer is possible or if the best one has too few samples, as of furniture
    in front of a person out of range.
    """
    if not own.any():
        return NO_LAYER
    depth_m, weights = person.depth_m[own], person.weights[own]
    order = depth_m.argsort()
    ranked_m = depth_m[order]
    first, end = (ranked_m.searchsorted(depth_m + reach_m) for reach_m in (-HALF_M, HALF_M))
    total, fit = float(weights.sum()), _fit(depth_m, person)
    scores = _sums(weights[order], first, end) / max(total, 1e-9) * fit
    best = int(scores.argmax())
    score = float(scores[best])
    part = score * total / max(float(person.weights.sum()), 1e-9)
    if part <= 0 or part < SCORE_MIN:
        return NO_LAYER
    near_m = ranked_m[first[best] : end[best]]
    layer_m = float(near_m[(len(near_m) - 1) // 2] + near_m[len(near_m) // 2]) / 2
    return _Choice(layer_m, score)


def _sums(weights: F64, first: Indices, end: Indices) -> F64:
    """Return the sums of N weights, each from a first one to before an end."""
    sums = np.zeros(len(weights) + 1)
    np.cumsum(weights, out=sums[1:])
    return sums[end] - sums[first]


def _fit(depth_m: F64, person: DepthSamples) -> F64:
    """Return the weight of depths by the size of the person, 0 where all measures are impossible.

    At larger depths the person would be implausibly large, at smaller ones small. If only widths
    are known, a nearer person may be turned: for random turns, a width has the density z / z_s. The
    box of a cut-off person without a measure may contain much background, so depths are weighted by
    1 / z.
    """
    size = person.size
    if size is None:
        return depth_m.min() / depth_m if person.cut_off else np.ones(len(depth_m))
    ratio = depth_m / size.depth_m
    fit = np.maximum(np.exp(-np.square(np.log(ratio) / SIZE_SIGMA) / 2), MISFIT)
    if size.has_height:
        fit = np.where(ratio < 1 / SMALLER_MAX, 0.0, fit)
    else:
        fit = np.where(ratio < 1, np.maximum(ratio, fit), fit)
    return np.where(depth_m > LARGER_MAX * size.farthest_m, 0.0, fit)


def _on(person: DepthSamples, other: DepthSamples, layer: PersonLayer) -> Flags:
    """Return flags of a person's samples that lie on another person.

    They are inside the outline of the other person, at the depth of the nearest sample in the
    image, since a head bent to the camera is in front of the torso's layer.
    """
    on = np.abs(person.depth_m - layer.depth_m) <= 2 * HALF_M
    near = np.flatnonzero(on)
    on[near] = _inside(person.pixels[near], other)
    if on.any():
        body = layer.own & (np.abs(other.depth_m - layer.depth_m) <= HALF_M)
        apart_px = person.pixels[on, None] - other.pixels[body]
        nearest = np.einsum("ijk,ijk->ij", apart_px, apart_px).argmin(axis=1)
        on[on] = np.abs(person.depth_m[on] - other.depth_m[body][nearest]) <= HALF_M
    return on


def _inside(pixels: F64, other: DepthSamples) -> Flags:
    """Return flags of Nx2 pixels inside the outline of another person.

    It is the convex hull of the samples and the crown, and the margin around it.
    """
    outline = other.pixels if other.crown_px is None else np.vstack([other.pixels, other.crown_px])
    low_px, high_px = outline.min(axis=0) - other.margin_px, outline.max(axis=0) + other.margin_px
    inside: Flags = ((pixels >= low_px - 1) & (pixels <= high_px + 1)).all(axis=1)
    if not inside.any():
        return inside
    pixels = pixels[inside]
    hull = cv2.convexHull(outline.astype(np.float32))[:, 0].astype(np.float64)
    sides = np.concatenate([hull[1:], hull[:1]]) - hull
    off = pixels[:, None] - hull
    across = sides[:, 0] * off[..., 1] - sides[:, 1] * off[..., 0]
    lengths = np.maximum((sides * sides).sum(axis=1), 1e-9)
    along = np.minimum(np.maximum((off * sides).sum(axis=2) / lengths, 0.0), 1.0)
    off -= along[..., None] * sides
    nearest = (off * off).sum(axis=2).min(axis=1)
    is_within = (across >= 0).all(axis=1) | (across <= 0).all(axis=1)
    inside[inside] = is_within | (nearest <= other.margin_px**2)
    return inside
