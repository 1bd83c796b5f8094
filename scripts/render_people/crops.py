"""Crops of rendered people: the body as a detector cuts it, and the upper body.

Channels are red, green, blue, and the planes of PersonView.
"""

import cv2
import numpy as np

from people4d.messages import HIDDEN_RGB, U8
from scripts.render_people.outfits import Rng
from scripts.render_people.views import PersonView

BODY_PX = (80, 40)  # [px] height and width of stored crops of bodies
FULL_BOX = 0.6  # share of boxes that include hidden parts of the body
UPPER_PX = (96, 72)  # [px] height and width of stored crops of upper bodies
UPPER_M = (1.65, 1.24)  # [m] height and width of such a crop at the person's depth
ABOVE_M = 0.75  # [m] part of that height above the shoulders
OUTSIDE = (*HIDDEN_RGB, 0, 255, 0)  # pixel outside of the image


def body(rng: Rng, rgb: U8, view: PersonView) -> U8 | None:
    """Return the crop of a person with a detector's box, HxWx6; None if it is too small."""
    own = view.planes[..., 0]
    rows, columns = np.flatnonzero(own.any(axis=1)), np.flatnonzero(own.any(axis=0))
    visible_px = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], np.float64)
    share = rng.uniform(0, 1, 4) if rng.random() < FULL_BOX else np.zeros(4)
    box_px = visible_px + share * (view.box_px - visible_px)
    low, high = box_px[1::-1], box_px[:1:-1]
    size = high - low
    low = np.clip(np.rint(low - size * rng.uniform(-0.04, 0.1, 2)), 0, None).astype(int)
    high = np.clip(np.rint(high + size * rng.uniform(-0.04, 0.1, 2)), low + 4, own.shape)
    window = (slice(low[0], int(high[0])), slice(low[1], int(high[1])))
    if min(rgb[window].shape[:2]) < 8 or not own[window].any():
        return None
    return reduced(rgb[window], view.planes[window], BODY_PX)


def upper_body(rgb: U8, view: PersonView) -> U8 | None:
    """Return the crop around the shoulders, HxWx6; None if no person is visible."""
    image = np.dstack([rgb, view.planes])
    px_per_m = view.focal_px / view.depth_m
    size = np.array(UPPER_M) * px_per_m
    corner = view.shoulders_px[::-1] - (ABOVE_M * px_per_m, size[1] / 2)
    low = np.rint(corner).astype(int)
    high = np.maximum(np.rint(corner + size).astype(int), low + 4)
    inside_low, inside_high = np.clip(low, 0, image.shape[:2]), np.clip(high, 0, image.shape[:2])
    if (inside_high <= inside_low).any():
        return None
    window = np.empty((*(high - low), 6), np.uint8)
    window[:] = OUTSIDE
    at, to = inside_low - low, inside_high - low
    part = image[inside_low[0] : inside_high[0], inside_low[1] : inside_high[1]]
    window[at[0] : to[0], at[1] : to[1]] = part
    if not window[..., 3].any():
        return None
    return reduced(window[..., :3], window[..., 3:], UPPER_PX)


def reduced(rgb: U8, planes: U8, size_px: tuple[int, int]) -> U8:
    """Return colours and planes (HxWx3 each) at a size, height and width, HxWx6."""
    halves = [
        cv2.resize(np.ascontiguousarray(half), size_px[::-1], interpolation=cv2.INTER_AREA)
        for half in (rgb, planes)
    ]
    return np.dstack(halves)
