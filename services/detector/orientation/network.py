"""The orientation network: yaws by images, trained on simulated people (scripts/train_orientation).

It uses features beyond keypoints: hair or a face, the back or the front of clothes.
"""

import math
from functools import cache

import cv2
import numpy as np

from common.inference.session import Session, check_input, first_output
from people4d.errors import ModelError
from people4d.messages import F32, F64, HIDDEN_RGB, U8
from services.detector.images import Window, bordered, cut_window, reduced
from services.detector.orientation.angle import SHOULDERS
from services.detector.orientation.joint import ANGLES
from services.detector.position.surface import DepthImage

SIZE_PX = (64, 48)  # height and width of the input [px]
SIZE_M = (1.1, 0.827)  # height and width of the window, at the person's depth [m]
ABOVE_M = 0.5  # part of the window above the shoulders [m]
LAYER_M = (-0.4, 0.5)  # depths of the person's mask, relative to the person's depth [m]
OUTLIERS = 0.05  # probability of an image that does not show the person
LOG_MIN = -50.0  # minimum log probability
OUTSIDE_MM = 1  # depth assumed outside the image [mm]
BLANK: F32 = np.array(HIDDEN_RGB, np.float32)[:, None, None]


class OrientationNetwork:
    """Network from images (Nx4x64x48: RGB and mask, 0 to 1) to log probabilities of yaws (NxS).

    The circle has S sectors. Yaws count from the line of sight; the middle of the first sector is
    0, facing away, the next ones are to the left.

    Args:
        session: Session of the network.

    Raises:
        ModelError: The input or output of the network has another form.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        check_input(session, (None, 4, *SIZE_PX), "orientation network")
        output = first_output(session, np.zeros((1, 4, *SIZE_PX), np.float32))
        if output.ndim != 2:
            found = list(output.shape)
            raise ModelError(f"orientation network: expected an output of NxS, got {found}")

    def log_likelihood(self, images: F32) -> F64:
        """Return the log likelihood of `ANGLES` given N images (Nx4x64x48), NxA."""
        log_p = np.clip(first_output(self._session, images), LOG_MIN, 0.0)
        sectors = np.exp(log_p - log_p.max(axis=1, keepdims=True))
        sectors /= sectors.sum(axis=1, keepdims=True)
        count = sectors.shape[1]
        sectors = (1 - OUTLIERS) * sectors + OUTLIERS / count
        by_image: F64 = np.log(sectors) @ between(count)
        return by_image


@cache
def between(sectors: int) -> F64:
    """Return the weights (SxA) that interpolate values of S sectors at `ANGLES`."""
    off = np.abs(ANGLES / (2 * math.pi / sectors) - np.arange(sectors)[:, None]) % sectors
    weights: F64 = np.maximum(1 - np.minimum(off, sectors - off), 0.0)
    return weights


def upper_bodies(rgb: U8, image: DepthImage, keypoints: F32, depths_m: F64) -> F32:
    """Return the upper bodies of N people as input of the network, Nx4x64x48.

    Args:
        rgb: Colour image, HxWx3.
        image: Depth image, HxW.
        keypoints: Nx17x3, u and v in pixels and confidence, COCO order.
        depths_m: [m] N, depths of the people.
    """
    shoulders_px = keypoints[:, SHOULDERS, :2].astype(np.float64).mean(axis=1)
    px_per_m = np.array([[image.info.fx, image.info.fy]]) / depths_m[:, None]
    corners_px = shoulders_px - (SIZE_M[1] / 2, ABOVE_M) * px_per_m
    sides_px = np.hstack([corners_px, corners_px + SIZE_M[::-1] * px_per_m])
    bodies = np.empty((len(keypoints), 4, *SIZE_PX), np.float32)
    for body, sides, depth_m in zip(bodies, sides_px.tolist(), depths_m.tolist(), strict=True):
        _draw_body(body, rgb, image, cut_window(sides, rgb.shape[1], rgb.shape[0]), depth_m)
    bodies[:, :3] /= 255
    return bodies


def _draw_body(
    body: F32, rgb: U8, image: DepthImage, window: Window | None, depth_m: float
) -> None:
    """Draw one body (4x64x48), colours 0 to 255; pixels nearer or outside the image are blanked.

    Args:
        body: Drawing.
        rgb: Colour image.
        image: Depth image.
        window: Window of the body; None: outside the image.
        depth_m: Depth of the person.
    """
    if window is None:
        body[:3], body[3] = BLANK, 0.0
        return
    nearest_mm, farthest_mm = (round(1000 * (depth_m + reach_m)) for reach_m in LAYER_M)
    bordered_mm = bordered(image.depth_mm[window.inside], window.edges, (OUTSIDE_MM,))
    depths_mm = cv2.resize(bordered_mm, SIZE_PX[::-1], interpolation=cv2.INTER_NEAREST)
    # Minus 1, a missing reading wraps to the farthest.
    hidden = (depths_mm - np.uint16(1)) < max(nearest_mm - 1, OUTSIDE_MM)
    colours = bordered(rgb[window.inside], window.edges, HIDDEN_RGB)
    body[:3] = reduced(colours, SIZE_PX).transpose(2, 0, 1)
    np.less_equal(depths_mm, farthest_mm, out=body[3])
    if hidden.any():
        np.copyto(body[:3], BLANK, where=hidden)
        body[3][hidden] = 0.0
