"""Position of the torso: the mean of shoulders and hips, even if some are hidden.

It is the reference point of tracks and motion capture. Depth is read in windows on the torso, off
its outline; readings outside of the person's own layer of depth (a wall, an outstretched arm, an
occluder) do not count. Each window gives the axis, their mean is the position (docs/method.md
section 10).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F32, F64, CameraInfo
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
    LayerWindows,
    PersonLayer,
    assign_layers,
    read_layers,
)
from services.detector.position.proportions import size_depth, torso_middles
from services.detector.position.surface import (
    TORSO,
    DepthImage,
    Flags,
    PositionEstimate,
    read_depth,
)
from services.detector.position.visible_area import (
    BOX_SIGMA_M,
    EMPTY,
    area_pixels,
    box_torso,
    cut_side,
    in_image,
    read_pixels,
)

OTHERS = [i for i in range(17) if i not in TORSO]  # face and limbs
TORSO_ROWS = (
    0.20,
    0.275,
    0.35,
    0.425,
    0.50,
)  # rows from chest to hips, relative to a mask's height
PULL = 0.3  # shift of a window from its joint to the torso's middle, off the outline
# Distance from the image's edge within which a cut-off person's joints are guesses [px]
EDGE_PX = 8.0
WINDOW_SHARE = 0.12  # side of a window, relative to the torso's diagonal
WINDOW_MIN_PX, WINDOW_MAX_PX = 5, 31  # limits of the side of a window [px]
MARGIN_SHARE = 0.25  # outline beyond the keypoints, relative to the torso's diagonal
OTHER_WEIGHT = 0.5  # weight of a sample off the torso
AREA_WEIGHT = 2.0  # total weight of all samples of the visible area
# Distance of the axis behind face and limbs if the torso is hidden, and its standard deviation [m]
LIMB_OFFSET_M, LIMB_SIGMA_M = 0.06, 0.1


@dataclass(frozen=True, slots=True)
class SamplePoints:
    """Pixels at which the depth of one person is read."""

    torso_px: F64  # [px] Nx2, middles of windows on the torso
    window_px: int  # [px] side of the windows
    others_px: F64  # [px] Nx2, middles of windows at other keypoints
    area_px: F64  # [px] Nx2, single pixels in the visible area


@dataclass(frozen=True, slots=True)
class TorsoJoints:
    """Torso of one person in the image."""

    joints_px: F64  # [px] 4x2, shoulders and hips
    known: Flags  # 4, joints that are confident and inside the image
    diagonal_px: float  # [px] extent of the known joints, 0 if there are none
    box_xyxy_px: F32  # [px] 4
    points: SamplePoints


LayeredTorso = tuple[TorsoJoints, PersonLayer]


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

        Keypoints above the minimum confidence and inside the image count. None without keypoints,
        or without depth of the person.
        """
        torsos = [_joints(person, confidence_min, image.info) for person in people]
        known = [torso for torso in torsos if torso is not None]
        read = _samples([torso.points for torso in known], image)
        samples = [_sized(*pair, image.info) for pair in zip(known, read, strict=True)]
        layers = iter(assign_layers(samples))
        found: list[LayeredTorso | None] = []
        for torso in torsos:
            layer = next(layers) if torso else None
            found.append((torso, layer) if torso and layer else None)
        return found

    def estimate(
        self,
        torsos: Sequence[LayeredTorso | None],
        image: DepthImage,
        yaws_rad: Sequence[float | None],
    ) -> list[PositionEstimate | None]:
        """Return the positions of torsos by their joints; yaws in the camera's body frame."""
        known = [pair for pair in torsos if pair is not None]
        windows = [
            LayerWindows(
                torso.points.torso_px[layer.own[: len(torso.points.torso_px)]],
                torso.points.window_px,
                layer.depth_m,
            )
            for torso, layer in known
        ]
        own_yaws_rad = [yaw for pair, yaw in zip(torsos, yaws_rad, strict=True) if pair]
        middles = _middles(known, image.info, own_yaws_rad)
        depths_m = read_layers(windows, image)
        positions = iter(
            self._on_axis(*each, image.info)
            for each in zip(middles, windows, depths_m, own_yaws_rad, strict=True)
        )
        return [None if pair is None else next(positions) for pair in torsos]

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
        window_px = _window(height * float(np.ptp(TORSO_ROWS)))
        (layer,) = assign_layers(_samples([SamplePoints(torso_px, window_px, EMPTY, EMPTY)], image))
        if layer is None:
            return None
        position_m = deproject(torso_px.mean(axis=0), [layer.depth_m], image.info)[0]
        middle = _Middle(position_m, variances_across(layer.depth_m, image.info)[0], 0.0)
        windows = LayerWindows(torso_px, window_px, layer.depth_m)
        (depth_m,) = read_layers([windows], image)
        return self._on_axis(middle, windows, depth_m, yaw_rad, image.info)

    def _on_axis(
        self,
        middle: _Middle,
        windows: LayerWindows,
        depth_m: F64,
        yaw_rad: float | None,
        info: CameraInfo,
    ) -> PositionEstimate:
        """Return the position on the axis, by the depth in windows on the torso."""
        layer_m, read = windows.layer_m, np.isfinite(depth_m)
        if read.any():
            right_m = deproject(windows.pixels, np.full(len(read), layer_m), info)[read, 0]
            offset_m = self._to_axis(right_m - middle.position_m[0], middle.position_m, yaw_rad)
            axis_m = depth_m[read] + offset_m
            sigma_m = axis_sigma(self._ellipse, yaw_rad)
        else:
            axis_m = np.array([layer_m + (LIMB_OFFSET_M if self._ellipse else 0.0)])
            sigma_m = LIMB_SIGMA_M
        position_m = middle.position_m * (axis_m.mean() / layer_m)
        along_m2 = variance_along(layer_m, axis_m, sigma_m, self._depth_error_per_m)
        across_m2 = middle.across_m2
        return PositionEstimate(
            position_m, covariance(position_m, across_m2, across_m2, along_m2 + middle.along_m2)
        )

    def _to_axis(self, right_m: F64, middle_m: F64, yaw_rad: float | None) -> F64:
        """Return the distance from points on the surface to the axis, along the optical axis."""
        if self._ellipse is None:
            return np.zeros(len(right_m))
        cosine = middle_m[2] / math.hypot(middle_m[0], middle_m[2])
        yaw_to_ray_rad = relative_yaw(middle_m, yaw_rad)
        offset_m: F64 = surface_to_axis(right_m * cosine, yaw_to_ray_rad, self._ellipse) * cosine
        return offset_m


def _joints(person: DetectedPerson, confidence_min: float, info: CameraInfo) -> TorsoJoints | None:
    """Return the torso of one person in the image; no joint need be known."""
    keypoints = person.keypoints
    if keypoints is None:
        return None
    pixels = keypoints[:, :2].astype(np.float64)
    confident = keypoints[:, 2] > confidence_min
    joints_px = pixels[TORSO]
    known = confident[TORSO] & in_image(joints_px, info, EDGE_PX)
    torso_px, diagonal_px = joints_px[known], 0.0
    if known.any():
        middle_px = torso_px.mean(axis=0)
        diagonal_px = math.dist(torso_px.max(axis=0), torso_px.min(axis=0))
        torso_px = np.vstack([torso_px + (middle_px - torso_px) * PULL, middle_px])
    visible = confident & in_image(pixels, info)
    others_px = pixels[OTHERS][visible[OTHERS]]
    area_px = area_pixels(person.box_xyxy_px, joints_px, known, info)
    points = SamplePoints(torso_px, _window(diagonal_px), others_px, area_px)
    return TorsoJoints(joints_px, known, diagonal_px, person.box_xyxy_px, points)


def _window(torso_px: float) -> int:
    """Return the odd side of windows on a torso of a size in the image."""
    return min(max(round(WINDOW_SHARE * torso_px), WINDOW_MIN_PX), WINDOW_MAX_PX) | 1


def _samples(people: Sequence[SamplePoints], image: DepthImage) -> list[DepthSamples]:
    """Return the first depth samples: on torsos, at other keypoints, in visible areas."""
    if not people:
        return []
    windows_px = [np.concatenate([points.torso_px, points.others_px]) for points in people]
    sides_px = np.repeat([points.window_px for points in people], list(map(len, windows_px)))
    windows_m = read_depth(np.concatenate(windows_px), image, sides_px)
    area_m = read_pixels(np.concatenate([points.area_px for points in people]), image)
    samples, window, pixel = [], 0, 0
    for points, keypoints_px in zip(people, windows_px, strict=True):
        counts = [len(points.torso_px), len(points.others_px), len(points.area_px)]
        ends = window + len(keypoints_px), pixel + len(points.area_px)
        depth_m = np.concatenate([windows_m[window : ends[0]], area_m[pixel : ends[1]]])
        weights = [1.0, OTHER_WEIGHT, AREA_WEIGHT / max(counts[2], 1)]
        pixels = np.concatenate([keypoints_px, points.area_px])
        samples.append(DepthSamples(pixels, depth_m, np.repeat(weights, counts)))
        window, pixel = ends
    return samples


def _sized(torso: TorsoJoints, samples: DepthSamples, info: CameraInfo) -> DepthSamples:
    """Return the depth samples of a torso with its size."""
    left, top, right, _ = torso.box_xyxy_px.tolist()
    return replace(
        samples,
        size=size_depth(torso.joints_px, torso.known, info),
        crown_px=((left + right) / 2, top),
        margin_px=MARGIN_SHARE * torso.diagonal_px,
        cut_off=cut_side(torso.box_xyxy_px, info) != 0,
    )


def _middles(
    torsos: Sequence[LayeredTorso], info: CameraInfo, yaws_rad: Sequence[float | None]
) -> list[_Middle]:
    """Return the middles of torsos by their joints; by the box if none is known."""
    layers_m = np.array([layer.depth_m for _, layer in torsos])
    joints_px = np.array([torso.joints_px for torso, _ in torsos]).reshape(-1, 2)
    joints_m = deproject(joints_px, np.repeat(layers_m, 4), info)[:, :2].reshape(-1, 4, 2)
    known = np.array([torso.known for torso, _ in torsos]).reshape(-1, 4)
    found = torso_middles(joints_m, known, yaws_rad, joint_sigma(layers_m, info))
    middles = []
    for (torso, layer), middle_m, across_m2 in zip(torsos, *found, strict=True):
        position_m, variance_m2 = np.array([*middle_m, layer.depth_m]), float(across_m2)
        if not torso.known.any():
            pixel = box_torso(torso.box_xyxy_px, layer.depth_m, info)
            position_m = deproject(pixel, [layer.depth_m], info)[0]
            variance_m2 = BOX_SIGMA_M**2
        middles.append(_Middle(position_m, variance_m2, layer.along_m2))
    return middles
