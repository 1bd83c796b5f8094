"""Position of the torso: the mean of both shoulders and both hips, also when some are hidden.

Motion capture and tracks mean this point. Depth is read in windows on the torso, off its outline;
readings outside of the person's own layer of depth (a wall, an arm stretched out, somebody in
front) do not count. Each window gives the axis, their mean is the position (docs/method.md section
10).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F32, F64
from services.detector.config import EllipseConfig, TorsoConfig, UncertaintyConfig
from services.detector.models.base import InstanceMask
from services.detector.position.axis import (
    axis_sigma,
    covariance,
    joint_sigma,
    relative_yaw,
    surface_to_axis,
    variance_along,
)
from services.detector.position.layers import (
    DepthSamples,
    PersonLayer,
    assign_layers,
    layer_variance,
    read_layer,
)
from services.detector.position.proportions import Flags, size_depth, torso_middle
from services.detector.position.surface import TORSO, DepthImage, PositionEstimate, read_depth

OTHERS = [i for i in range(17) if i not in TORSO]  # face and limbs
TORSO_ROWS = (0.20, 0.275, 0.35, 0.425, 0.50)  # of a mask's height: chest to hips of the upright
WINDOW_MIN_PX = 5


@dataclass(frozen=True, slots=True)
class TorsoJoints:
    """Torso of one person in the image."""

    joints_px: F64  # [px] 4x2, shoulders and hips
    known: Flags  # 4, joints that are confident and inside the image
    torso_px: F64  # [px] Nx2, windows of depth on the torso
    window_px: int  # [px] side of the windows
    samples: DepthSamples  # at torso_px, then at other keypoints


LayeredTorso = tuple[TorsoJoints, PersonLayer]


@dataclass(frozen=True, slots=True)
class _Middle:
    """Middle of a torso before its depth is read exactly."""

    position_m: F64  # [m] 3, optical frame, at the depth of the person's layer
    across_m2: float  # [m^2] variance across the line of sight
    along_m2: float  # [m^2] that of the layer, along it


class TorsoEstimator:
    """Estimates positions of torsos; without an ellipse they stay on the surface."""

    def __init__(
        self, config: TorsoConfig, ellipse: EllipseConfig | None, uncertainty: UncertaintyConfig
    ) -> None:
        self._config = config
        self._ellipse = ellipse
        self._uncertainty = uncertainty

    def find(
        self, keypoints: Sequence[F32 | None], confidence_min: float, image: DepthImage
    ) -> list[LayeredTorso | None]:
        """Return the torso of each person of a frame, and the layer of depth that it is in.

        Keypoints are 17x3 each, u and v in pixels and confidence. None where no joint is more
        confident than the minimum and inside the image, or no depth is the person's.
        """
        torsos = [
            None if points is None else self._joints(points, confidence_min, image)
            for points in keypoints
        ]
        samples = [torso.samples for torso in torsos if torso is not None]
        layers = iter(assign_layers(samples, self._config.layer))
        found: list[LayeredTorso | None] = []
        for torso in torsos:
            layer = next(layers) if torso else None
            found.append((torso, layer) if torso and layer else None)
        return found

    def _joints(
        self, keypoints: F32, confidence_min: float, image: DepthImage
    ) -> TorsoJoints | None:
        """Return the torso of one person in the image; None if no joint is known."""
        info, config = image.info, self._config
        joints_px = keypoints[TORSO, :2].astype(np.float64)
        known = keypoints[TORSO, 2] > confidence_min
        edge = (info.width - 0.5, info.height - 0.5)
        known &= ((joints_px > -0.5) & (joints_px < edge)).all(axis=1)
        if not known.any():
            return None
        middle_px = joints_px[known].mean(axis=0)
        torso_px = joints_px[known] + (middle_px - joints_px[known]) * config.pull
        torso_px = np.vstack([torso_px, middle_px])
        diagonal_px = float(np.linalg.norm(np.ptp(joints_px[known], axis=0)))
        window_px = self._window(diagonal_px)
        others_px = keypoints[OTHERS, :2][keypoints[OTHERS, 2] > confidence_min].astype(np.float64)
        samples = replace(
            self._samples(torso_px, others_px, window_px, image),
            size_depth_m=size_depth(joints_px, known, info, config.proportions),
            margin_px=config.margin_share * diagonal_px,
        )
        return TorsoJoints(joints_px, known, torso_px, window_px, samples)

    def estimate(
        self, torso: TorsoJoints, layer: PersonLayer, image: DepthImage, yaw_rad: float | None
    ) -> PositionEstimate:
        """Return the position of a torso by its joints; yaw in the camera's body frame."""
        joints_m = deproject(torso.joints_px, np.full(4, layer.depth_m), image.info)[:, :2]
        sigma_m = joint_sigma(layer.depth_m, image.info, self._uncertainty)
        middle_m, across_m2 = torso_middle(
            joints_m, torso.known, yaw_rad, sigma_m, self._config.proportions
        )
        own_px = torso.torso_px[layer.own[: len(torso.torso_px)]]
        along_m2 = layer_variance(torso.samples, layer, self._config.layer.half_m)
        middle = _Middle(np.array([*middle_m, layer.depth_m]), across_m2, along_m2)
        return self._on_axis(middle, own_px, torso.window_px, image, yaw_rad)

    def estimate_from_mask(
        self, mask: InstanceMask, image: DepthImage, yaw_rad: float | None
    ) -> PositionEstimate | None:
        """Return the position by the upper middle of a mask; None without depth there."""
        rows = np.flatnonzero(mask.window.any(axis=1))
        if not len(rows):
            return None
        height = rows[-1] - rows[0] + 1
        chosen = rows[np.searchsorted(rows, rows[0] + np.array(TORSO_ROWS) * (height - 1))]
        columns = [float(np.flatnonzero(mask.window[row]).mean()) for row in chosen]
        torso_px = np.column_stack([mask.x_px + np.array(columns), mask.y_px + chosen])
        window_px = self._window(height * float(np.ptp(TORSO_ROWS)))
        samples = self._samples(torso_px, torso_px[:0], window_px, image)
        layer = assign_layers([samples], self._config.layer)[0]
        if layer is None:
            return None
        position_m = deproject(torso_px.mean(axis=0), [layer.depth_m], image.info)[0]
        config = self._uncertainty
        across_m2 = config.centroid_m**2 + (config.joint_px * layer.depth_m / image.info.fx) ** 2
        middle = _Middle(position_m, across_m2, 0.0)
        return self._on_axis(middle, torso_px, window_px, image, yaw_rad)

    def _window(self, torso_px: float) -> int:
        """Return the odd side of windows on a torso of a size in the image."""
        window_px = round(self._config.window_share * torso_px)
        return min(max(window_px, WINDOW_MIN_PX), self._config.window_max_px) | 1

    def _samples(
        self, torso_px: F64, others_px: F64, window_px: int, image: DepthImage
    ) -> DepthSamples:
        """Read depth for the first time, on the torso and, after that, at other keypoints."""
        pixels = np.vstack([torso_px, others_px])
        counts = [len(torso_px), len(others_px)]
        weights = np.repeat([1.0, self._config.layer.other_weight], counts)
        return DepthSamples(pixels, read_depth(pixels, image, window_px), weights)

    def _on_axis(
        self,
        middle: _Middle,
        torso_px: F64,
        window_px: int,
        image: DepthImage,
        yaw_rad: float | None,
    ) -> PositionEstimate:
        """Return the position on the axis, by the depth in windows on the torso."""
        layer_m, half_m = float(middle.position_m[2]), self._config.layer.half_m
        read = np.zeros(len(torso_px), np.bool_)
        if len(torso_px):
            depth_m = read_layer(torso_px, window_px, image, layer_m, half_m)
            read = np.isfinite(depth_m)
        if read.any():
            right_m = deproject(torso_px, np.full(len(read), layer_m), image.info)[read, 0]
            offset_m = self._to_axis(right_m - middle.position_m[0], middle.position_m, yaw_rad)
            axis_m = depth_m[read] + offset_m
            sigma_m = axis_sigma(self._ellipse, yaw_rad, self._uncertainty)
        else:
            axis_m = np.array([layer_m + (self._config.limb_offset_m if self._ellipse else 0.0)])
            sigma_m = self._config.limb_sigma_m
        position_m = middle.position_m * (axis_m.mean() / layer_m)
        along_m2 = variance_along(layer_m, axis_m, sigma_m, self._uncertainty) + middle.along_m2
        across_m2 = middle.across_m2
        return PositionEstimate(position_m, covariance(position_m, across_m2, across_m2, along_m2))

    def _to_axis(self, right_m: F64, middle_m: F64, yaw_rad: float | None) -> F64:
        """Return the distance from points on the surface to the axis, along the optical axis."""
        if self._ellipse is None:
            return np.zeros(len(right_m))
        cosine = middle_m[2] / math.hypot(middle_m[0], middle_m[2])
        yaw_to_ray_rad = relative_yaw(middle_m, yaw_rad)
        offset_m: F64 = surface_to_axis(right_m * cosine, yaw_to_ray_rad, self._ellipse) * cosine
        return offset_m
