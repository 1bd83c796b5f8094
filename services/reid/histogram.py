"""Body-part colour histograms: an embedder that needs no weights.

Head, torso and legs each have a hue-saturation histogram (docs/method.md section 8.1) and bins of
grey, because black, grey and white clothes have no hue. With the square root of the shares, the dot
product of two vectors is the Bhattacharyya coefficient, weighted by part.
"""

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from common.transport.trace import span
from people4d.messages import F32, F64, HIDDEN_RGB, U8, Crop
from services.reid.config import ReidConfig

HUES = 12
SATURATIONS = 4
GREYS = 8
BINS = HUES * SATURATIONS + GREYS
PART_WEIGHTS = (0.15, 0.5, 0.35)  # weights of head, torso, legs
PART_EDGES = (0.0, 0.18, 0.48, 1.0)  # edges of the parts from the top, relative to the height
CHROMA_GREY, CHROMA_FULL = 0.06, 0.2  # saturation times value of a grey and of a coloured pixel
PRIOR_FRACTION = 0.05  # uniform prior, relative to the part's pixels; makes hidden parts match all
HEIGHT_PX = 64  # maximum height of a crop, else scaled down [px]
CONFIDENCE_MIN = 0.3  # minimum confidence of keypoints that divide the body
SIDE_SPREAD = 0.35  # spread of pixel weights without mask or keypoints, per half box
LIMB_WIDTH = 0.15  # ratio of a limb's width to the torso's length; the head is twice as wide
VISIBLE_MIN = 0.05  # minimum visible share of the weights; below it all pixels count
HEAD = [0, 1, 2, 3, 4]  # COCO
TORSO = [5, 6, 12, 11]  # COCO, round the outline: left, right shoulder, right, left hip
LIMBS = ((5, 7), (7, 9), (6, 8), (8, 10), (11, 13), (13, 15), (12, 14), (14, 16))


def load(config: ReidConfig) -> "HistogramEmbedder":  # noqa: ARG001
    """Make the embedder; it has no settings."""
    return HistogramEmbedder()


class HistogramEmbedder:
    """Body-part hue-saturation histograms under the square root."""

    name = "histogram"
    dimension = len(PART_WEIGHTS) * BINS

    def embed(self, crops: Sequence[Crop]) -> F32:
        """Embed crops as rows of unit length."""
        with span("embedding"):
            return _embed(crops)


def _embed(crops: Sequence[Crop]) -> F32:
    """Return the vectors of crops; the pixels of all crops are sorted into bins together."""
    parts = len(PART_WEIGHTS)
    pixels = [np.empty((0, 3), np.float32)]
    weights, starts = [np.empty(0)], [np.empty(0, np.intp)]
    for number, crop in enumerate(crops):
        rgb, weight, part = _pixels(crop)
        pixels.append(rgb)
        weights.append(weight)
        starts.append((part + number * parts) * BINS)
    bins, shares = _bins(np.concatenate(pixels))
    bins += np.concatenate(starts)
    shares *= np.concatenate(weights)
    counts = np.bincount(bins.ravel(), shares.ravel(), minlength=len(crops) * parts * BINS)
    counts = counts.reshape(len(crops), parts, BINS)
    prior = np.maximum(PRIOR_FRACTION * counts.sum(axis=2, keepdims=True), 1e-6) / BINS
    filled = counts + prior
    share = np.array(PART_WEIGHTS)[:, None] * filled / filled.sum(axis=2, keepdims=True)
    return np.asarray(np.sqrt(share).reshape(len(crops), parts * BINS), np.float32)


def _pixels(crop: Crop) -> tuple[F32, F64, npt.NDArray[np.intp]]:
    """Return the weighted pixels of one reduced crop: Nx3 colour, 0 to 1, weight, part."""
    height = min(HEIGHT_PX, crop.rgb.shape[0])
    width = max(1, round(crop.rgb.shape[1] * height / crop.rgb.shape[0]))
    scaled = cv2.resize(crop.rgb, (width, height), interpolation=cv2.INTER_NEAREST)
    rgb = np.asarray(scaled, np.uint8)
    weights = _without_hidden(_body_weights(crop, (height, width)), rgb)
    edges = np.rint(_part_edges(crop) * height)
    part = np.searchsorted(edges[1:-1], np.arange(height), side="right")
    used = weights > 0
    rows = np.broadcast_to(part[:, None], used.shape)
    return np.asarray(rgb[used] / 255, np.float32), weights[used], rows[used]


def _without_hidden(weights: F64, rgb: U8) -> F64:
    """Return the weights without hidden pixels, unless hardly any would remain."""
    visible = weights * (rgb != np.array(HIDDEN_RGB, np.uint8)).any(axis=2)
    return visible if visible.sum() >= VISIBLE_MIN * weights.sum() else weights


def _body_weights(crop: Crop, shape: tuple[int, int]) -> F64:
    """Return the weight of each pixel of the scaled crop (height, width).

    Weights are the mask, else a thickly drawn skeleton, else fall towards the sides of the box.
    """
    height, width = shape
    if crop.mask is not None and crop.mask.any():
        mask = (crop.mask != 0).astype(np.float32)
        return np.asarray(cv2.resize(mask, (width, height), interpolation=cv2.INTER_NEAREST), float)
    if crop.keypoints is not None and (crop.keypoints[TORSO, 2] > CONFIDENCE_MIN).all():
        skeleton = _skeleton(crop.keypoints, height / crop.rgb.shape[0], shape)
        if skeleton.any():
            return skeleton.astype(np.float64)
    across = (np.arange(width) + 0.5) / width * 2 - 1
    weights: F64 = np.tile(np.exp(-0.5 * (across / SIDE_SPREAD) ** 2), (height, 1))
    return weights


def _skeleton(keypoints: F32, scale: float, shape: tuple[int, int]) -> U8:
    """Return an image of a shape with torso, limbs, neck and head set to 1."""
    # Clipped, since a wild coordinate would overflow the integers of the drawing.
    points = np.rint(np.clip(keypoints[:, :2] * scale, -9999, 9999)).astype(np.int32)
    confident = keypoints[:, 2] > CONFIDENCE_MIN
    shoulders, hips = points[TORSO].reshape(2, 2, 2).mean(axis=1)
    thick = max(1, round(float(np.linalg.norm(shoulders - hips)) * LIMB_WIDTH))
    image = np.zeros(shape, np.uint8)
    cv2.fillConvexPoly(image, points[TORSO], 1)
    for a, b in LIMBS:
        if confident[a] and confident[b]:
            cv2.line(image, points[a].tolist(), points[b].tolist(), 1, min(thick, 255))
    if confident[HEAD].any():
        head = points[HEAD][confident[HEAD]].mean(axis=0)
        top, neck = np.rint([head, shoulders]).astype(int).tolist()
        cv2.line(image, top, neck, 1, min(2 * thick, 255))
    return image


def _part_edges(crop: Crop) -> F64:
    """Return the upper edges of head, torso and legs and the lower end, 0 to 1 of the height."""
    edges = np.array(PART_EDGES)
    if crop.keypoints is None:
        return edges
    for index, pair in ((1, TORSO[:2]), (2, TORSO[2:])):
        if (crop.keypoints[pair, 2] > CONFIDENCE_MIN).all():
            edges[index] = crop.keypoints[pair, 1].mean() / crop.rgb.shape[0]
    return np.maximum.accumulate(np.clip(edges, 0, 1))


def _bins(rgb: F32) -> tuple[npt.NDArray[np.intp], F64]:
    """Return the six bins around each pixel, and its share in each.

    Args:
        rgb: Nx3, 0 to 1.

    Returns:
        6xN bins and shares; a pixel's shares add up to 1. The first four are neighbours in hue
        and saturation, the last two in grey.
    """
    if not len(rgb):
        return np.empty((6, 0), np.intp), np.empty((6, 0))
    hue, saturation, value = cv2.cvtColor(rgb[None], cv2.COLOR_RGB2HSV)[0].astype(float).T
    chroma = np.clip((saturation * value - CHROMA_GREY) / (CHROMA_FULL - CHROMA_GREY), 0, 1)
    h, h_rest = _split(hue / 360 * HUES)
    s, s_rest = _split(saturation * (SATURATIONS - 1))
    g, g_rest = _split(value * (GREYS - 1))
    bins, shares = np.empty((6, len(rgb)), np.intp), np.empty((6, len(rgb)))
    for row, (dh, ds) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        column = np.minimum(s + ds, SATURATIONS - 1)
        bins[row] = (h + dh) % HUES * SATURATIONS + column
        shares[row] = chroma * np.abs(1 - dh - h_rest) * np.abs(1 - ds - s_rest)
    for dg in (0, 1):
        bins[4 + dg] = HUES * SATURATIONS + np.minimum(g + dg, GREYS - 1)
        shares[4 + dg] = (1 - chroma) * np.abs(1 - dg - g_rest)
    return bins, shares


def _split(position: F64) -> tuple[npt.NDArray[np.intp], F64]:
    """Return the integral and the fractional part."""
    integral = np.floor(position)
    return integral.astype(np.intp), position - integral
