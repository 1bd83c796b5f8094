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
from typing import NamedTuple

import cv2
import numpy as np

from people4d.messages import F64
from services.detector.config import LayerConfig
from services.detector.position.proportions import BodySize, Flags
from services.detector.position.surface import DepthImage, read_windows


@dataclass(frozen=True, slots=True)
class DepthSamples:
    """First readings of depth on one person."""

    pixels: F64  # [px] Nx2, points on the person
    depth_m: F64  # [m] N, NaN without a reading
    weights: F64  # N, 1 on the torso
    size: BodySize | None = None  # None: unknown
    crown_px: tuple[float, float] | None = None  # [px] top of the person; None: unknown
    margin_px: float = 0.0  # [px] outline of the person beyond the points and the crown
    cut_off: bool = False  # one side of the image cuts the person off
    range_m: float = math.inf  # [m] beyond it the camera reads no depth


@dataclass(frozen=True, slots=True)
class PersonLayer:
    """Layer of depth that a person is in."""

    depth_m: float  # [m] its middle
    own: Flags  # N, samples that no other person covers
    along_m2: float = 0.0  # [m^2] variance of the depth since the torso may be in another layer
    across_m2: float = 0.0  # [m^2] and across, since the joints may be of somebody behind


class _Choice(NamedTuple):
    """Best layer of a person's own samples."""

    depth_m: float  # [m] NaN where the score is 0
    score: float  # 0 to 1, less the share of samples that are rather beyond the camera's range
    along_m2: float  # [m^2] as of `PersonLayer`
    across_m2: float  # [m^2]


NO_LAYER = _Choice(math.nan, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class LayerWindows:
    """Windows of depth on one person, in whose layer they are read."""

    pixels: F64  # [px] Nx2, their middles
    window_px: int  # [px] odd side
    layer_m: float  # [m] middle of the layer


def assign_layers(people: Sequence[DepthSamples], config: LayerConfig) -> list[PersonLayer | None]:
    """Return the layer of each person of a frame, None without own samples.

    People are assigned in the order of their agreement with one layer, those of unknown size last.
    Samples that are rather beyond the camera's range do not agree: of somebody there only those on
    a person in front have readings. Samples that lie on a person who has a layer do not count for
    others.
    """
    layers: list[PersonLayer | None] = [None] * len(people)
    finite = [np.isfinite(person.depth_m) for person in people]
    beyond = [_beyond(person, config) for person in people]
    alone = [_best(*one, config) for one in zip(people, finite, beyond, strict=True)]
    order = sorted(range(len(people)), key=lambda k: (people[k].size is None, -alone[k].score))
    before: list[int] = []
    for k in order:
        person, own = people[k], finite[k]
        for other in before:
            layer = layers[other]
            if layer is not None:
                taken = own & _on(person, people[other], layer, config.half_m)
                own = own & ~taken if taken.any() else own
        is_alone = own is finite[k]
        best = alone[k] if is_alone else _best(person, own, beyond[k], config)
        if best.score > 0:
            layers[k] = PersonLayer(best.depth_m, own, best.along_m2, best.across_m2)
        before.append(k)
    return layers


def read_layers(people: Sequence[LayerWindows], image: DepthImage, half_m: float) -> list[F64]:
    """Return the depth in the windows of people by the readings of one layer each only.

    At an outline that is the person's side of it.

    Args:
        people: Windows of each.
        image: The depth.
        half_m: [m] half the depth of a layer.

    Returns:
        N in metres for each, NaN where no reading lies in the layer.
    """
    counts = [len(windows.pixels) for windows in people]
    if not sum(counts):
        return [np.zeros(0) for _ in people]
    window_px = np.repeat([windows.window_px for windows in people], counts)
    layer_m = np.repeat([windows.layer_m for windows in people], counts)
    pixels = np.concatenate([windows.pixels for windows in people])
    depth_m, _ = read_windows(pixels, image, window_px, layer_m - half_m, layer_m + half_m)
    return np.split(depth_m, np.cumsum(counts[:-1]))


def _best(person: DepthSamples, own: Flags, beyond: float, config: LayerConfig) -> _Choice:
    """Return the best layer; `beyond` is the share of samples rather beyond the camera's range.

    Another layer of a fraction p of the sum of both squared scores, a gap away, makes the depth
    uncertain by p (1 - p) gap^2. If it is farther, the joints may be those of a person there who
    looks out beside the one in front: across, the position is uncertain by p (1 - p) beside_m^2.
    Readings of the best layer do not count for it: they are the person's own arms and legs. The
    score is 0 if no layer is possible, or the best one has next to nothing of the person, readings
    that are absent or out of range counted, or less than those do as a layer beyond the camera's
    range: furniture, or somebody else, before a person whom it does not reach.
    """
    if not own.any():
        return NO_LAYER
    depth_m, weights = person.depth_m[own], person.weights[own]
    near = np.abs(depth_m[:, None] - depth_m) <= config.half_m
    parts = weights / max(float(weights.sum()), 1e-9)
    fit = _fit(depth_m, person, config)
    scores = near @ parts * fit
    best = int(np.argmax(scores))
    part = float(scores[best] * weights.sum()) / max(float(person.weights.sum()), 1e-9)
    if part <= 0 or part < max(config.score_min, config.missing_weight * beyond):
        return NO_LAYER
    ranked_m = np.sort(depth_m[near[best]])
    layer_m = float(ranked_m[(len(ranked_m) - 1) // 2] + ranked_m[len(ranked_m) // 2]) / 2
    score = float(scores[best])
    agreement = score * (1 - beyond)
    apart = np.abs(depth_m - layer_m) > config.half_m
    if not apart.any():
        return _Choice(layer_m, agreement, 0.0, 0.0)
    others = apart * (near @ (parts * apart)) * fit
    second = int(np.argmax(others))
    fraction = float(others[second] ** 2 / (score**2 + others[second] ** 2))
    gap_m = float(depth_m[second]) - layer_m
    uncertainty = fraction * (1 - fraction)
    beside_m = config.beside_m if gap_m > 0 else 0.0
    return _Choice(layer_m, agreement, uncertainty * gap_m**2, uncertainty * beside_m**2)


def _beyond(person: DepthSamples, config: LayerConfig) -> float:
    """Return the share of a person's samples without a reading as a layer beyond the range.

    It is 0 of a person of unknown size.
    """
    missing = ~np.isfinite(person.depth_m)
    if person.size is None or not missing.any():
        return 0.0
    beyond_m = np.array([max(person.range_m, person.size.depth_m)])
    share = float(person.weights[missing].sum()) / max(float(person.weights.sum()), 1e-9)
    return share * float(_fit(beyond_m, person, config)[0])


def _fit(depth_m: F64, person: DepthSamples, config: LayerConfig) -> F64:
    """Return the weight of depths by the size of the person, 0 where all measures are impossible.

    Farther away the person would be larger than people are, nearer smaller. Where widths alone are
    known, a nearer person is turned: of bodies turned at random, a width has the density z / z_s.
    The box of people who are cut off, without a measure, may hold an arm and much of the
    background: depths weigh 1 / z.
    """
    size = person.size
    if size is None:
        return depth_m.min() / depth_m if person.cut_off else np.ones(len(depth_m))
    ratio = depth_m / size.depth_m
    fit = np.maximum(np.exp(-np.square(np.log(ratio) / config.size_sigma) / 2), config.misfit)
    if size.has_height:
        fit = np.where(ratio < 1 / config.smaller_max, 0.0, fit)
    else:
        fit = np.where(ratio < 1, np.maximum(ratio, fit), fit)
    return np.where(depth_m > config.larger_max * size.farthest_m, 0.0, fit)


def _on(person: DepthSamples, other: DepthSamples, layer: PersonLayer, half_m: float) -> Flags:
    """Return which samples of a person lie on another one.

    They lie inside the outline of the other, whose sample nearest in the image is as far away: a
    head bent to the camera is before the layer of its torso.
    """
    on = np.abs(person.depth_m - layer.depth_m) <= 2 * half_m
    on[on] = _inside(person.pixels[on], other)
    if on.any():
        body = layer.own & (np.abs(other.depth_m - layer.depth_m) <= half_m)
        apart_px = person.pixels[on, None] - other.pixels[body]
        nearest = np.einsum("ijk,ijk->ij", apart_px, apart_px).argmin(axis=1)
        on[on] = np.abs(person.depth_m[on] - other.depth_m[body][nearest]) <= half_m
    return on


def _inside(pixels: F64, other: DepthSamples) -> Flags:
    """Return which of Nx2 pixels lie inside the outline of another person."""
    if not len(pixels):
        return np.zeros(0, np.bool_)
    crown_px = [] if other.crown_px is None else [other.crown_px]
    hull = cv2.convexHull(np.array([*other.pixels, *crown_px], np.float32))
    inside_px = [cv2.pointPolygonTest(hull, (float(u), float(v)), True) for u, v in pixels]
    return np.array(inside_px) >= -other.margin_px
