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
from services.detector.models.base import DetectedPerson, InstanceMask
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
    read_layer,
)
from services.detector.position.proportions import Flags, size_depth, torso_middle
from services.detector.position.surface import TORSO, DepthImage, PositionEstimate, read_depth
from services.detector.position.visible_area import area_pixels, box_torso, in_image, read_pixels

OTHERS = [i for i in range(17) if i not in TORSO]  # face and limbs
TORSO_ROWS = (0.20, 0.275, 0.35, 0.425, 0.50)  # of a mask's height: chest to hips of the upright
WINDOW_MIN_PX = 5
# Somebody is out of range who is beyond this part of it by size, with fewer windows read
RANGE_PART, READ_MIN = 0.9, 0.5


@dataclass(frozen=True, slots=True)
class TorsoJoints:
    """Torso of one person in the image."""

    joints_px: F64  # [px] 4x2, shoulders and hips
    known: Flags  # 4, joints that are confident and inside the image
    torso_px: F64  # [px] Nx2, windows of depth on the torso
    window_px: int  # [px] side of the windows
    box_xyxy_px: F32  # [px] 4
    samples: DepthSamples  # at torso_px, then at other keypoints and in the visible area


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
        self, people: Sequence[DetectedPerson], confidence_min: float, image: DepthImage
    ) -> list[LayeredTorso | None]:
        """Return the torso of each person of a frame, and the layer of depth that it is in.

        Keypoints count that are more confident than the minimum and inside the image. None without
        keypoints, or where no depth is the person's.
        """
        torsos = [self._joints(person, confidence_min, image) for person in people]
        samples = [torso.samples for torso in torsos if torso is not None]
        layers = iter(assign_layers(samples, self._config.layer))
        found: list[LayeredTorso | None] = []
        for torso in torsos:
            layer = next(layers) if torso else None
            found.append((torso, layer) if torso and layer else None)
        return found

    def _joints(
        self, person: DetectedPerson, confidence_min: float, image: DepthImage
    ) -> TorsoJoints | None:
        """Return the torso of one person in the image; no joint need be known.

        None for somebody out of the camera's range: what depth there is would be of furniture.
        """
        info, config, keypoints = image.info, self._config, person.keypoints
        if keypoints is None:
            return None
        pixels = keypoints[:, :2].astype(np.float64)
        confident = keypoints[:, 2] > confidence_min
        joints_px = pixels[TORSO]
        known = confident[TORSO] & in_image(joints_px, info, config.edge_px)
        torso_px, diagonal_px = joints_px[known], 0.0
        if known.any():
            middle_px = torso_px.mean(axis=0)
            diagonal_px = float(np.linalg.norm(np.ptp(torso_px, axis=0)))
            torso_px = np.vstack([torso_px + (middle_px - torso_px) * config.pull, middle_px])
        window_px = self._window(diagonal_px)
        visible = confident & in_image(pixels, info)
        others_px = pixels[OTHERS][visible[OTHERS]]
        area_px = area_pixels(person.box_xyxy_px, joints_px, known, info, config.area)
        size = size_depth(joints_px, known, info, config.proportions)
        samples = self._samples(torso_px, others_px, area_px, window_px, image)
        read = np.isfinite(samples.depth_m[: len(torso_px)])
        far_m = RANGE_PART * info.max_depth_m
        if size is not None and size.depth_m > far_m and read.mean() < READ_MIN:
            return None
        samples = replace(samples, size=size, margin_px=config.margin_share * diagonal_px)
        return TorsoJoints(joints_px, known, torso_px, window_px, person.box_xyxy_px, samples)

    def estimate(
        self, torso: TorsoJoints, layer: PersonLayer, image: DepthImage, yaw_rad: float | None
    ) -> PositionEstimate:
        """Return the position of a torso by its joints; yaw in the camera's body frame."""
        own_px = torso.torso_px[layer.own[: len(torso.torso_px)]]
        middle = self._middle(torso, layer, image, yaw_rad)
        return self._on_axis(middle, own_px, torso.window_px, image, yaw_rad)

    def _middle(
        self, torso: TorsoJoints, layer: PersonLayer, image: DepthImage, yaw_rad: float | None
    ) -> _Middle:
        """Return the middle of a torso by its joints; by the box where none is known."""
        info, layer_m = image.info, layer.depth_m
        if not torso.known.any():
            area = self._config.area
            pixel = box_torso(torso.box_xyxy_px, layer_m, info, area)
            position_m = deproject(pixel, [layer_m], info)[0]
            return _Middle(position_m, area.sigma_m**2, layer.variance_m2)
        joints_m = deproject(torso.joints_px, np.full(4, layer_m), info)[:, :2]
        sigma_m = joint_sigma(layer_m, info, self._uncertainty)
        proportions = self._config.proportions
        middle_m, across_m2 = torso_middle(joints_m, torso.known, yaw_rad, sigma_m, proportions)
        return _Middle(np.array([*middle_m, layer_m]), across_m2, layer.variance_m2)

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
        samples = self._samples(torso_px, torso_px[:0], torso_px[:0], window_px, image)
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
        self, torso_px: F64, others_px: F64, area_px: F64, window_px: int, image: DepthImage
    ) -> DepthSamples:
        """Read depth for the first time: on the torso, at other keypoints, in the visible area."""
        config = self._config.layer
        keypoints_px = np.vstack([torso_px, others_px])
        windows_m, area_m = read_depth(keypoints_px, image, window_px), read_pixels(area_px, image)
        area_weight = config.area_weight / max(len(area_px), 1)
        counts = [len(torso_px), len(others_px), len(area_px)]
        return DepthSamples(
            np.vstack([keypoints_px, area_px]),
            np.concatenate([windows_m, area_m]),
            np.repeat([1.0, config.other_weight, area_weight], counts),
        )

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
