"""The body network: one look at each person in colour and depth, trained on simulated people.

It estimates the middle of the torso relative to a point in the person's layer of depth, hidden
torsos included (docs/method.md section 10, scripts/train_body).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from common.geometry.transforms import deproject
from common.inference.session import Session, check_input, first_output
from people4d.errors import ModelError
from people4d.messages import F32, F64, HIDDEN_RGB, U8, U16
from services.detector.images import bordered, cut_window, reduced
from services.detector.position.surface import DepthImage, PositionEstimate

SIZE_PX = (48, 32)  # height and width of the input [px]
SIZE_M = (1.6512, 1.1008)  # height and width of the window, at the person's depth [m]
ABOVE_M = 0.2  # part of the window above the box [m]
REFERENCE_M = 0.5  # reference point of offsets, below the window's upper edge [m]
CHANNELS = 7  # red, green, blue, mask, relative depth, relief, readings
OUTPUTS = 9  # outputs for each person, in the order of `_decoded`
LAYER_M = (-0.4, 0.5)  # depths of the person's mask, relative to the person's depth [m]
REACH_M, RELIEF_M = 0.6, 0.2  # limits of the channels of relative depth and of relief [m]
SCALE_M = 0.3  # unit of the offsets [m]
SIGMA_MIN_M = 0.01  # minimum standard deviation of the torso's middle [m]
UNREAD_MM, OUTSIDE_MM = 0, 65535  # depths without a reading, and outside the image [mm]


class BodyImages(NamedTuple):
    """Images of the candidates of one frame."""

    images: F32  # Nx7x48x32, input of the network
    points_m: F64  # [m] Nx3, reference points of the offsets, optical frame


class BodyNetwork:
    """Network from images of N candidates (Nx7x48x32) to Nx9 values.

    Args:
        session: Session of the network.

    Raises:
        ModelError: The input or output of the network has another form.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        check_input(session, (None, CHANNELS, *SIZE_PX), "body network")
        output = first_output(session, np.zeros((1, CHANNELS, *SIZE_PX), np.float32))
        if output.shape != (1, OUTPUTS) or not np.isfinite(output).all():
            found = list(output.shape)
            raise ModelError(f"body network: expected finite outputs of Nx{OUTPUTS}, got {found}")

    @staticmethod
    def candidates(
        boxes_xyxy_px: F64, layers_m: F64, rgb: U8, image: DepthImage, margin_px: int = 0
    ) -> BodyImages:
        """Return the images of N boxes (Nx4), each in a layer of depth (N, in metres).

        Training cuts its shifted images out of larger ones, with a margin on each side.
        """
        references_px = _references(boxes_xyxy_px, layers_m, image)
        images = _images(references_px, layers_m, rgb, image, margin_px)
        return BodyImages(images, deproject(references_px, layers_m, image.info))

    def observe(self, candidates: BodyImages) -> list[PositionEstimate]:
        """Return the positions of N candidates."""
        outputs = first_output(self._session, candidates.images).tolist()
        return list(map(_decoded, outputs, candidates.points_m))


def _references(boxes_xyxy_px: F64, layers_m: F64, image: DepthImage) -> F64:
    """Return the pixels of the reference points of N boxes, Nx2."""
    middles_px = (boxes_xyxy_px[:, 0] + boxes_xyxy_px[:, 2]) / 2
    below_px = (REFERENCE_M - ABOVE_M) * image.info.fy / layers_m
    return np.column_stack([middles_px, boxes_xyxy_px[:, 1] + below_px])


def _images(references_px: F64, layers_m: F64, rgb: U8, image: DepthImage, margin_px: int) -> F32:
    """Return the input of the network for N reference points and depths, Nx7x48x32 and margins.

    Colours are 0 to 1. Relative depth and relief are divided by their limits, and 0 if unread.
    """
    height, width = (side_px + 2 * margin_px for side_px in SIZE_PX)
    margin_m = margin_px * SIZE_M[0] / SIZE_PX[0]
    inputs = np.zeros((len(layers_m), CHANNELS, height, width), np.float32)
    depths_mm = np.empty((len(layers_m), 2 * height, 2 * width), np.uint16)
    points = zip(references_px.tolist(), layers_m.tolist(), strict=True)
    for k, ((u, v), depth_m) in enumerate(points):
        across_px, down_px = image.info.fx / depth_m, image.info.fy / depth_m
        left = u - (SIZE_M[1] / 2 + margin_m) * across_px
        top = v - (REFERENCE_M + margin_m) * down_px
        right = left + (SIZE_M[1] + 2 * margin_m) * across_px
        sides = left, top, right, top + (SIZE_M[0] + 2 * margin_m) * down_px
        window = cut_window(sides, rgb.shape[1], rgb.shape[0])
        if window is None:
            inputs[k, :3] = np.array(HIDDEN_RGB)[:, None, None]
            depths_mm[k] = OUTSIDE_MM
            continue
        colours = bordered(rgb[window.inside], window.edges, HIDDEN_RGB)
        inputs[k, :3] = reduced(colours, (height, width)).transpose(2, 0, 1)
        near_mm = bordered(image.depth_mm[window.inside], window.edges, (OUTSIDE_MM,))
        cv2.resize(near_mm, (2 * width, 2 * height), depths_mm[k], interpolation=cv2.INTER_NEAREST)
    inputs[:, :3] /= 255
    inputs[:, 3:] = _depth_channels(depths_mm, layers_m)
    return inputs


def _depth_channels(depths_mm: U16, layers_m: F64) -> F32:
    """Return mask, relative depth, relief and readings of depths (NxHxW), Nx4x(H/2)x(W/2)."""
    outside = depths_mm == OUTSIDE_MM
    read = (depths_mm != UNREAD_MM) & ~outside
    behind_m = depths_mm.astype(np.float32) / 1000 - layers_m[:, None, None].astype(np.float32)
    behind_m[~read] = 0.0
    mask = (behind_m >= LAYER_M[0]) & (behind_m <= LAYER_M[1]) & ~outside
    channels = np.stack(
        [
            mask,
            np.clip(behind_m / REACH_M, -1, 1),
            np.clip(behind_m / RELIEF_M, -1, 1),
            read,
        ],
        axis=1,
        dtype=np.float32,
        casting="unsafe",
    )
    count, height, width = depths_mm.shape
    pairs = channels.reshape(count, channels.shape[1], height // 2, 2, width // 2, 2)
    halved: F32 = pairs.mean(axis=(3, 5))
    return halved


def _decoded(values: Sequence[float], point_m: F64) -> PositionEstimate:
    """Return the position by the outputs of the network and its reference point.

    The outputs are the logit of a person, the logit of the visible share, the offset to the right
    and along the line of sight, the Cholesky factor of its covariance, the offset downward and
    its standard deviation.
    """
    person, _, right, along, first, both, second, down, sigma = values
    axes = offset_axes(point_m)
    offset_m = SCALE_M * np.array([right, down, along])
    factor = np.array(
        [[_positive(first), 0, 0], [0, _positive(sigma), 0], [both, 0, _positive(second)]]
    )
    root = axes.T @ factor
    probability = (1 + math.tanh(person / 2)) / 2
    return PositionEstimate(point_m + axes.T @ offset_m, root @ root.T, probability)


def offset_axes(point_m: F64) -> F64:
    """Return the axes of offsets from a point: right, down and along the level line of sight."""
    x, _, z = point_m.tolist()
    level = math.hypot(x, z)
    return np.array([[z / level, 0, -x / level], [0, 1, 0], [x / level, 0, z / level]])


def _positive(value: float) -> float:
    """Return the softplus of a value, at least the minimum standard deviation."""
    return max(value, 0.0) + math.log1p(math.exp(-abs(value))) + SIGMA_MIN_M
