"""Pixels at which the depth of a torso is read: on it, at other keypoints, in the visible area.

Windows lie off the torso's outline. The size of the torso and the edge of its box bound the depth
of a person (docs/method.md section 10).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress
from typing import NamedTuple, TypeAlias

import numpy as np

from people4d.messages import F64, CameraInfo
from services.detector.models.base import DetectedPerson
from services.detector.position.layers import DepthSamples
from services.detector.position.proportions import size_depth
from services.detector.position.surface import TORSO, DepthImage, DepthWindows
from services.detector.position.visible_area import (
    GRID,
    area_grids,
    cut_side,
    in_image,
    read_pixels,
    visible_area,
)

OTHERS = [i for i in range(17) if i not in TORSO]  # face and limbs
Pixel: TypeAlias = tuple[float, float]
Rectangle: TypeAlias = tuple[float, float, float, float]
PULL = 0.3  # shift of a window from its joint to the torso's middle, off the outline
# Distance from the image's edge within which a cut-off person's joints are guesses [px]
EDGE_PX = 8.0
WINDOW_SHARE = 0.12  # side of a window, relative to the torso's diagonal
WINDOW_MIN_PX, WINDOW_MAX_PX = 5, 31  # limits of the side of a window [px]
MARGIN_SHARE = 0.25  # outline beyond the keypoints, relative to the torso's diagonal
OTHER_WEIGHT = 0.5  # weight of a sample off the torso
AREA_WEIGHT = 2.0  # total weight of all samples of the visible area


@dataclass(frozen=True, slots=True)
class TorsoJoints:
    """Torso of one person in the image."""

    joints_px: Sequence[Pixel]  # [px] shoulders and hips
    known: Sequence[bool]  # joints that are confident and inside the image
    diagonal_px: float  # [px] extent of the known joints, 0 if there are none
    box_xyxy_px: Sequence[float]  # [px] 4


class SampledTorso(NamedTuple):
    """Torso whose depth is to be read."""

    joints: TorsoJoints
    torso_px: Sequence[Pixel]  # [px] middles of windows on the torso
    others_px: Sequence[Pixel]  # [px] middles of windows at other keypoints
    area_px: Rectangle | None  # [px] visible area: left, top, width, height


def sampled_torsos(
    people: Sequence[DetectedPerson], confidence_min: float, info: CameraInfo
) -> list[SampledTorso]:
    """Return the torsos of people in the image; no joint is known without keypoints."""
    found = [np.zeros((17, 3)) if p.keypoints is None else p.keypoints for p in people]
    keypoints = np.array(found, np.float64).reshape(-1, 17, 3)
    pixels, confident = keypoints[:, :, :2], keypoints[:, :, 2] > np.float32(confidence_min)
    known = confident[:, TORSO] & in_image(pixels[:, TORSO], info, EDGE_PX)
    visible = confident & in_image(pixels, info)
    each = zip(people, known.tolist(), pixels.tolist(), visible.tolist(), strict=True)
    return [_sampled(*one, info) for one in each]


def _sampled(
    person: DetectedPerson,
    known: Sequence[bool],
    pixels: Sequence[Pixel],
    visible: Sequence[bool],
    info: CameraInfo,
) -> SampledTorso:
    """Return the pixels at which the depth of one person is read.

    Args:
        person: The person.
        known: Flags of the known shoulders and hips.
        pixels: Keypoints, u and v.
        visible: Flags of the confident ones inside the image.
        info: Calibration of the camera.
    """
    joints_px, box_xyxy_px = [pixels[k] for k in TORSO], person.box_xyxy_px.tolist()
    torso_px = list(compress(joints_px, known))
    diagonal_px = 0.0
    if torso_px:
        us, vs = zip(*torso_px, strict=True)
        u, v = sum(us) / len(us), sum(vs) / len(vs)
        diagonal_px = math.dist((max(us), max(vs)), (min(us), min(vs)))
        torso_px = [(x + (u - x) * PULL, y + (v - y) * PULL) for x, y in torso_px]
        torso_px.append((u, v))
    others_px = [pixels[k] for k in OTHERS if visible[k]]
    area_px = visible_area(box_xyxy_px, joints_px, known, info)
    torso = TorsoJoints(joints_px, known, diagonal_px, box_xyxy_px)
    return SampledTorso(torso, torso_px, others_px, area_px)


def window_side(torso_px: float) -> int:
    """Return the odd side of windows on a torso of a size in the image."""
    return min(max(round(WINDOW_SHARE * torso_px), WINDOW_MIN_PX), WINDOW_MAX_PX) | 1


def depth_samples(
    torsos: Sequence[SampledTorso], windows_px: F64, windows: DepthWindows, image: DepthImage
) -> list[DepthSamples]:
    """Return the first depth samples: on torsos, at other keypoints, in visible areas."""
    windows_m, _ = windows.medians(0.0, image.info.max_depth_m)
    grids = area_grids([torso.area_px for torso in torsos if torso.area_px])
    areas_m = read_pixels(grids.reshape(-1, 2), image).reshape(grids.shape[:2])
    areas = zip(grids, areas_m, strict=True)
    samples, first = [], 0
    for torso in torsos:
        joints, count = torso.joints, len(torso.torso_px) + len(torso.others_px)
        own = slice(first, first + count)
        pixels, depth_m = windows_px[own], windows_m[own]
        if torso.area_px:
            grid_px, grid_m = next(areas)
            pixels, depth_m = np.concatenate([pixels, grid_px]), np.concatenate([depth_m, grid_m])
        weights = np.full(len(pixels), AREA_WEIGHT / len(GRID))
        weights[:count] = OTHER_WEIGHT
        weights[: len(torso.torso_px)] = 1.0
        left, top, right, _ = joints.box_xyxy_px
        samples.append(
            DepthSamples(
                pixels,
                depth_m,
                weights,
                size=size_depth(joints.joints_px, joints.known, image.info),
                crown_px=((left + right) / 2, top),
                margin_px=MARGIN_SHARE * joints.diagonal_px,
                cut_off=cut_side(joints.box_xyxy_px, image.info) != 0,
            )
        )
        first = own.stop
    return samples
