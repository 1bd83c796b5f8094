"""Position of the torso: the mean of shoulders and hips, even if some are hidden.

It is the reference point of tracks and motion capture. Depth is read in windows on the torso, off
its outline; readings outside of the person's own layer of depth (a wall, an outstretched arm, an
occluder) do not count. Each window gives the axis, their mean is the position (docs/method.md
section 10).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, compress, islice
from typing import NamedTuple, TypeAlias

import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F64, CameraInfo
from services.detector.models.base import DetectedPerson, InstanceMask
from services.detector.position.axis import (
    Ellipse,
    axis_sigma,
    covariance,
    joint_sigma,
    relative_yaw,
    surface_to_axis,
    variance_along,
    variances_across,
)
from services.detector.position.layers import (
    DepthSamples,
    PersonLayer,
    assign_layers,
    read_layers,
)
from services.detector.position.proportions import torso_middles
from services.detector.position.surface import DepthImage, DepthWindows, PositionEstimate
from services.detector.position.torso_samples import (
    SampledTorso,
    TorsoJoints,
    depth_samples,
    sampled_torsos,
    window_side,
)
from services.detector.position.visible_area import BOX_SIGMA_M, box_torso

# [m] points: to the right of the optical axis at the depth of the layer, and depth as read
Surface: TypeAlias = Sequence[tuple[float, float]]
# Rows from chest to hips, relative to a mask's height
TORSO_ROWS = (0.20, 0.275, 0.35, 0.425, 0.50)
# Distance of the axis behind face and limbs if the torso is hidden, and its standard deviation [m]
LIMB_OFFSET_M, LIMB_SIGMA_M = 0.06, 0.1


class LayeredTorso(NamedTuple):
    """Torso of one person, the layer of depth that it is in, and its surface in that layer."""

    joints: TorsoJoints
    layer: PersonLayer
    surface: Surface


@dataclass(frozen=True, slots=True)
class _Middle:
    """Middle of a torso before its precise depth."""

    position_m: F64  # [m] 3, optical frame, at the depth of the person's layer
    across_m2: float  # [m^2] variance across the line of sight
    along_m2: float  # [m^2] variance of the layer along the line of sight


class TorsoEstimator:
    """Estimates positions of torsos.

    Args:
        ellipse: Cross section of the torso; None: positions stay on the surface.
        depth_error_per_m: [1/m] error of one depth reading, over z^2.
    """

    def __init__(self, ellipse: Ellipse | None, depth_error_per_m: float) -> None:
        self._ellipse = ellipse
        self._depth_error_per_m = depth_error_per_m

    def find_torsos(
        self, people: Sequence[DetectedPerson], confidence_min: float, image: DepthImage
    ) -> list[LayeredTorso | None]:
        """Return the torso of each person of a frame, and its layer of depth.

        Keypoints above the minimum confidence and inside the image count. None if keypoints or
        depth of the person are missing.
        """
        torsos = sampled_torsos(people, confidence_min, image.info)
        known = [torso for torso in torsos if torso is not None]
        if not known:
            return [None] * len(people)
        pixels = [[*torso.torso_px, *torso.others_px] for torso in known]
        counts = [*map(len, pixels)]
        sides_px = np.repeat([window_side(torso.joints.diagonal_px) for torso in known], counts)
        windows_px = np.array(list(chain(*pixels))).reshape(-1, 2)
        windows = DepthWindows(windows_px, image, sides_px)
        layers = assign_layers(depth_samples(known, windows_px, windows, image))
        layers_m = np.repeat([layer.depth_m if layer else 0.0 for layer in layers], counts)
        points = _surface(windows_px, layers_m, windows, image.info)
        surfaces = iter(points.tolist())
        own = (list(islice(surfaces, count)) for count in counts)
        found = map(_layered, known, layers, own)
        return [next(found) if torso else None for torso in torsos]

    def estimate(
        self,
        torsos: Sequence[LayeredTorso | None],
        info: CameraInfo,
        yaws_rad: Sequence[float | None],
    ) -> list[PositionEstimate | None]:
        """Return the positions of torsos by their joints; yaws in the camera's body frame."""
        known = [torso for torso in torsos if torso is not None]
        own_yaws_rad = [yaw for torso, yaw in zip(torsos, yaws_rad, strict=True) if torso]
        middles = _middles(known, info, own_yaws_rad)
        positions = iter(
            self._on_axis(middle, torso.layer.depth_m, torso.surface, yaw_rad)
            for middle, torso, yaw_rad in zip(middles, known, own_yaws_rad, strict=True)
        )
        return [None if torso is None else next(positions) for torso in torsos]

    def estimate_from_mask(
        self, mask: InstanceMask, image: DepthImage, yaw_rad: float | None
    ) -> PositionEstimate | None:
        """Return the position from the upper middle of a mask; None if depth is missing there."""
        rows = np.flatnonzero(mask.window.any(axis=1))
        if not len(rows):
            return None
        height = rows[-1] - rows[0] + 1
        chosen = rows[np.searchsorted(rows, rows[0] + np.array(TORSO_ROWS) * (height - 1))]
        columns = [float(np.flatnonzero(mask.window[row]).mean()) for row in chosen]
        torso_px = np.column_stack([mask.x_px + np.array(columns), mask.y_px + chosen])
        window_px = window_side(height * float(np.ptp(TORSO_ROWS)))
        windows = DepthWindows(torso_px, image, window_px)
        depth_m, _ = windows.medians(0.0, image.info.max_depth_m)
        (layer,) = assign_layers([DepthSamples(torso_px, depth_m, np.ones(len(depth_m)))])
        if layer is None:
            return None
        layers_m = np.full(len(torso_px), layer.depth_m)
        points = _surface(torso_px, layers_m, windows, image.info)
        surface = points[points[:, 1] > 0].tolist()
        position_m = deproject(torso_px.mean(axis=0), [layer.depth_m], image.info)[0]
        middle = _Middle(position_m, variances_across(layer.depth_m, image.info)[0], 0.0)
        return self._on_axis(middle, layer.depth_m, surface, yaw_rad)

    def _on_axis(
        self,
        middle: _Middle,
        layer_m: float,
        surface: Surface,
        yaw_rad: float | None,
    ) -> PositionEstimate:
        """Return the position on the axis, by the surface of the torso."""
        if surface:
            offsets_m = self._to_axis(surface, middle.position_m, yaw_rad)
            axis_m = [depth + offset for (_, depth), offset in zip(surface, offsets_m, strict=True)]
            sigma_m = axis_sigma(self._ellipse, yaw_rad)
        else:
            axis_m = [layer_m + (LIMB_OFFSET_M if self._ellipse else 0.0)]
            sigma_m = LIMB_SIGMA_M
        position_m = middle.position_m * (sum(axis_m) / len(axis_m) / layer_m)
        along_m2 = variance_along(layer_m, axis_m, sigma_m, self._depth_error_per_m)
        across_m2 = middle.across_m2
        return PositionEstimate(
            position_m,
            covariance(position_m.tolist(), across_m2, across_m2, along_m2 + middle.along_m2),
        )

    def _to_axis(self, surface: Surface, middle_m: F64, yaw_rad: float | None) -> list[float]:
        """Return the distances from the surface to the axis, along the optical axis."""
        if self._ellipse is None:
            return [0.0] * len(surface)
        x, _, z = middle_m.tolist()
        cosine = z / math.hypot(x, z)
        rights_m = [(right_m - x) * cosine for right_m, _ in surface]
        behind_m = surface_to_axis(rights_m, relative_yaw(middle_m, yaw_rad), self._ellipse)
        return [distance_m * cosine for distance_m in behind_m]


def _surface(pixels: F64, layers_m: F64, windows: DepthWindows, info: CameraInfo) -> F64:
    """Return the points of the surface in N windows around pixels, Nx2; NaN if unread."""
    points_m = deproject(pixels, layers_m, info)[:, :2]
    points_m[:, 1] = read_layers(windows, layers_m)
    return points_m


def _layered(
    torso: SampledTorso, layer: PersonLayer | None, points: Surface
) -> LayeredTorso | None:
    """Return a torso with its layer and the surface in windows that no other person covers."""
    if layer is None:
        return None
    own = layer.own[: len(torso.torso_px)].tolist()
    surface = [point for point in compress(points, own) if point[1] > 0]
    return LayeredTorso(torso.joints, layer, surface)


def _middles(
    torsos: Sequence[LayeredTorso], info: CameraInfo, yaws_rad: Sequence[float | None]
) -> list[_Middle]:
    """Return the middles of torsos by their joints; by the box if none is known."""
    layers_m = np.array([torso.layer.depth_m for torso in torsos])
    joints_px = np.array([torso.joints.joints_px for torso in torsos]).reshape(-1, 2)
    joints_m = deproject(joints_px, np.repeat(layers_m, 4), info)[:, :2].reshape(-1, 4, 2)
    known = np.array([torso.joints.known for torso in torsos]).reshape(-1, 4)
    found = torso_middles(joints_m, known, yaws_rad, joint_sigma(layers_m, info))
    middles = []
    for (torso, layer, _), middle_m, across_m2 in zip(torsos, *found, strict=True):
        position_m, variance_m2 = np.array([*middle_m, layer.depth_m]), float(across_m2)
        if not any(torso.known):
            pixel = box_torso(torso.box_xyxy_px, layer.depth_m, info)
            position_m = deproject(pixel, [layer.depth_m], info)[0]
            variance_m2 = BOX_SIGMA_M**2
        middles.append(_Middle(position_m, variance_m2, layer.along_m2))
    return middles
