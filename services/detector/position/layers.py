"""Assignment of people to layers of depth, with others before them or a wall behind.

Depth samples at many points of a person show several layers. The person's is the one that most
samples lie in and that agrees with the size in the image: somebody who covers half of a person
stands nearer, and would have to be a dwarf to appear as large. Samples in other layers do not
count, nor those of another person: where two overlap, the one whose samples agree better is in
front (docs/method.md section 10).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from people4d.messages import F64
from services.detector.config import LayerConfig
from services.detector.position.proportions import Flags
from services.detector.position.surface import DepthImage, read_depth


@dataclass(frozen=True, slots=True)
class DepthSamples:
    """First readings of depth on one person."""

    pixels: F64  # [px] Nx2, points on the person
    depth_m: F64  # [m] N, NaN without a reading
    weights: F64  # N, 1 on the torso
    size_depth_m: float | None = None  # [m] depth for a person of common size; None: unknown
    margin_px: float = 0.0  # [px] outline of the person beyond the points


@dataclass(frozen=True, slots=True)
class PersonLayer:
    """Layer of depth that a person is in."""

    depth_m: float  # [m] its middle
    own: Flags  # N, samples that no other person covers


def assign_layers(people: Sequence[DepthSamples], config: LayerConfig) -> list[PersonLayer | None]:
    """Return the layer of each person of a frame, None without own samples.

    People are assigned in the order of their agreement with one layer. Samples in an assigned
    layer, inside the outline of that person, do not count for others.
    """
    layers: list[PersonLayer | None] = [None] * len(people)
    finite = [np.isfinite(person.depth_m) for person in people]
    order = sorted(range(len(people)), key=lambda k: -_best(people[k], finite[k], config)[1])
    before: list[int] = []
    for k in order:
        person, own = people[k], finite[k]
        for other in before:
            layer = layers[other]
            if layer is not None:
                taken = np.abs(person.depth_m - layer.depth_m) <= config.half_m
                own = own & ~(taken & _inside(person.pixels, people[other]))
        if own.any():
            layers[k] = PersonLayer(_best(person, own, config)[0], own)
        before.append(k)
    return layers


def layer_variance(person: DepthSamples, layer: PersonLayer, half_m: float) -> float:
    """Return the variance, in m^2, by which the torso may be in another layer than the person's.

    Of samples on the torso, a fraction p lies in another layer, a gap away: p (1 - p) gap^2. So of
    two people detected as one. Samples farther than `half_m` from the layer are in another.
    """
    gaps_m = np.abs(person.depth_m - layer.depth_m)[layer.own & (person.weights == 1)]
    outside = gaps_m > half_m
    if not outside.any():
        return 0.0
    fraction = float(outside.mean())
    return fraction * (1 - fraction) * float(np.median(gaps_m[outside])) ** 2


def read_layer(
    pixels: F64, window_px: int, image: DepthImage, layer_m: float, half_m: float
) -> F64:
    """Return the depth at N pixels (Nx2, u and v) by the readings of one layer only.

    At an outline that is the person's side of it. NaN where no reading lies in the layer.
    """
    height, width = image.depth_mm.shape
    left, top = np.maximum(np.rint(pixels.min(axis=0)).astype(int) - window_px, 0)
    right, bottom = np.rint(pixels.max(axis=0)).astype(int) + window_px + 1
    cut_mm = image.depth_mm[top : min(bottom, height), left : min(right, width)]
    outside = np.abs(cut_mm / 1000.0 - layer_m) > half_m
    inside = DepthImage(np.where(outside, np.uint16(0), cut_mm), image.info)
    return read_depth(pixels - (left, top), inside, window_px, layer_m + half_m)


def _best(person: DepthSamples, own: Flags, config: LayerConfig) -> tuple[float, float]:
    """Return the depth of the best layer, and its score from 0 to 1."""
    if not own.any():
        return math.nan, 0.0
    depth_m, weights = person.depth_m[own], person.weights[own]
    near = np.abs(depth_m[:, None] - depth_m) <= config.half_m
    scores = near @ weights / weights.sum()
    if person.size_depth_m is not None:
        off = np.log(depth_m / person.size_depth_m) / config.size_sigma
        scores = scores * np.maximum(np.exp(-np.square(off) / 2), config.misfit)
    best = int(np.argmax(scores))
    return float(np.median(depth_m[near[best]])), float(scores[best])


def _inside(pixels: F64, other: DepthSamples) -> Flags:
    """Return which of Nx2 pixels lie inside the outline of another person."""
    hull = cv2.convexHull(other.pixels.astype(np.float32))
    inside_px = [cv2.pointPolygonTest(hull, (float(u), float(v)), True) for u, v in pixels]
    return np.array(inside_px) >= -other.margin_px
