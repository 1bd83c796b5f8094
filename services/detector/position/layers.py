"""Which layer of depth a person is in, where others stand before or a wall behind.

A first reading at many places of the person tells the layers that there are. The person's is the
one that most places are in and that agrees with the size in the image: whoever covers half of
somebody stands nearer, and would have to be a dwarf to look as large. Readings of other layers do
not count, nor those that are another person's: where two overlap, the one whose places agree better
is in front.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import msgspec
import numpy as np
import numpy.typing as npt

from people4d.messages import F64, U16
from services.detector.position.position import read_depth


class LayerRule(msgspec.Struct, frozen=True, kw_only=True):
    """How a layer is told; all values are this project's."""

    half_m: float = 0.25  # [m] readings farther from the middle of the layer do not count
    size_sigma: float = 0.2  # standard deviation of the logarithm of people's size, children too
    misfit: float = 0.02  # weight of a layer that does not suit the size at all, 1: that suits
    other_weight: float = 0.5  # weight of a place that is not on the trunk, 1: that is

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in ("half_m", "size_sigma"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected a number > 0, got {getattr(self, name)}")
        for name in ("misfit", "other_weight"):
            if not 0 < getattr(self, name) <= 1:
                raise ValueError(f"{name}: expected above 0 to 1, got {getattr(self, name)}")


@dataclass(frozen=True, slots=True)
class Places:
    """What a first reading tells about one person."""

    pixels: F64  # [px] Nx2, places on the person
    depth_m: F64  # [m] N, NaN where depth is not read
    weights: F64  # N, how much each counts
    common_m: float | None = None  # [m] at which the person would be of common size; None: unknown
    margin_px: float = 0.0  # [px] how far the person's outline lies beyond the places


@dataclass(frozen=True, slots=True)
class Layer:
    """The layer of depth that a person is in."""

    depth_m: float  # [m] its middle
    own: npt.NDArray[np.bool_]  # N, places that nobody else covers


def settle(people: Sequence[Places], rule: LayerRule) -> list[Layer | None]:
    """Return the layer of each person of a frame, None where nothing tells it.

    Who agrees best with one layer is settled first. What lies in that layer and inside the outline
    of that person belongs to nobody else.
    """
    settled: list[Layer | None] = [None] * len(people)
    everything = [np.isfinite(person.depth_m) for person in people]
    order = sorted(range(len(people)), key=lambda k: -_best(people[k], everything[k], rule)[1])
    before: list[int] = []
    for k in order:
        person, own = people[k], everything[k]
        for other in before:
            layer = settled[other]
            if layer is not None:
                taken = np.abs(person.depth_m - layer.depth_m) <= rule.half_m
                own = own & ~(taken & _covered(person.pixels, people[other]))
        if own.any():
            settled[k] = Layer(_best(person, own, rule)[0], own)
        before.append(k)
    return settled


def disagreement(person: Places, layer: Layer, half_m: float) -> float:
    """Return the variance, in m^2, by which the trunk may be in another layer than the person's.

    Of places on the trunk, a share p reads another layer, a gap away: p (1 - p) gap^2. So of two
    people found as one.

    Args:
        person: Whose places count as the trunk's where their weight is 1.
        layer: Of the person.
        half_m: Readings farther from the layer are in another.
    """
    gaps_m = np.abs(person.depth_m - layer.depth_m)[layer.own & (person.weights == 1)]
    outside = gaps_m > half_m
    if not outside.any():
        return 0.0
    share = float(outside.mean())
    return share * (1 - share) * float(np.median(gaps_m[outside])) ** 2


def _best(person: Places, own: npt.NDArray[np.bool_], rule: LayerRule) -> tuple[float, float]:
    """Return the depth of the best layer, and how well the places agree with it, 0 to 1."""
    if not own.any():
        return math.nan, 0.0
    depth_m, weights = person.depth_m[own], person.weights[own]
    near = np.abs(depth_m[:, None] - depth_m) <= rule.half_m
    scores = near @ weights / weights.sum()
    if person.common_m is not None:
        off = np.log(depth_m / person.common_m) / rule.size_sigma
        scores = scores * np.maximum(np.exp(-np.square(off) / 2), rule.misfit)
    best = int(np.argmax(scores))
    return float(np.median(depth_m[near[best]])), float(scores[best])


def _covered(pixels: F64, other: Places) -> npt.NDArray[np.bool_]:
    """Tell which of Nx2 pixels lie inside the outline of another person."""
    hull = cv2.convexHull(other.pixels.astype(np.float32))
    inside_px = [cv2.pointPolygonTest(hull, (float(u), float(v)), True) for u, v in pixels]
    return np.array(inside_px) >= -other.margin_px


def read_layer(pixels: F64, side_px: int, depth_mm: U16, layer_m: float, half_m: float) -> F64:
    """Return the depth at N pixels by the readings of one layer only.

    At an outline that is the person's side of it.

    Args:
        pixels: Nx2, u and v.
        side_px: Odd side of the windows whose medians are taken.
        depth_mm: Depth image, 0 = no reading.
        layer_m: Depth of the layer.
        half_m: Readings farther from it do not count.

    Returns:
        N in metres, NaN where the layer is not seen.
    """
    height, width = depth_mm.shape
    left, top = np.maximum(np.rint(pixels.min(axis=0)).astype(int) - side_px, 0)
    right, bottom = np.rint(pixels.max(axis=0)).astype(int) + side_px + 1
    cut_mm = depth_mm[top : min(bottom, height), left : min(right, width)]
    outside = np.abs(cut_mm / 1000.0 - layer_m) > half_m
    inside_mm = np.where(outside, np.uint16(0), cut_mm)
    return read_depth(pixels - (left, top), inside_mm, layer_m + half_m, side_px)
