"""Velocities of people by scene flow: where the surface of the torso was in the frame before.

Pixels of a torso are followed into the image before, and back, by pyramids of [Lucas 1981]; depth
is read at both ends of each. The middle movement over the time between both frames is the velocity
(docs/method.md section 10).
"""

import threading
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F32, F64, U8, U16, CameraInfo, RgbdFrame
from services.detector.config import VelocityConfig
from services.detector.position.axis import covariance
from services.detector.position.proportions import Flags
from services.detector.position.surface import DepthImage, read_windows
from services.detector.position.torso import LayeredTorso

GRID = 8, 14  # points on a torso across and down
MARGIN, MARGIN_DOWN = 0.25, 0.06  # beyond the joints, to each side: of their width, of the height
UPPER_BODY = 0.2, 0.2, 0.8, 0.55  # of a box, where joints are unknown: left, top, right, bottom
WINDOW_PX, LEVELS = 9, 3  # of optical flow
BACK_PX = 0.5  # [px] largest error of a point that was followed there and back
POINTS_MIN = 5  # that a velocity needs
LAYER_M, MOVED_M = 0.3, 0.35  # [m] largest distance from the person's layer, in this frame; in both
DEPTH_PX = 3  # [px] side of windows of depth


@dataclass(frozen=True, slots=True)
class VelocityEstimate:
    """Velocity of a person relative to the camera."""

    velocity_mps: F64  # [m/s] 3, optical frame
    covariance_m2ps2: F64  # 3x3, optical frame


@dataclass(frozen=True, slots=True)
class FlowFrame:
    """Images of a frame that the next one is compared with."""

    stamp_ns: int
    grey: U8  # HxW
    depth_mm: U16  # HxW


class SceneFlow:
    """Estimates velocities between successive frames of each camera."""

    def __init__(self, config: VelocityConfig) -> None:
        self._config = config
        self._lock = threading.Lock()
        self._frames: dict[str, FlowFrame] = {}  # last frame, by camera

    def next(self, frame: RgbdFrame) -> tuple[FlowFrame, FlowFrame | None]:
        """Store a frame; return it, and that before if it is of the same size and recent.

        Cameras are few: those that have a calibration.
        """
        grey = cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2GRAY)
        now = FlowFrame(frame.stamp_ns, np.asarray(grey, np.uint8), frame.depth_mm.copy())
        with self._lock:
            before = self._frames.get(frame.camera)
            is_late = before is not None and before.stamp_ns >= now.stamp_ns
            is_far = before is not None and self._is_far(before, now)
            # A frame that another thread took first stays; a clock that went back begins anew.
            if not is_late or is_far:
                self._frames[frame.camera] = now
        if before is None or is_late or is_far or before.grey.shape != now.grey.shape:
            return now, None
        return now, before

    def velocities(
        self,
        now: FlowFrame,
        before: FlowFrame,
        torsos: Sequence[LayeredTorso | None],
        info: CameraInfo,
    ) -> list[VelocityEstimate | None]:
        """Return the velocities of torsos in a frame; None where too few points were followed."""
        points = [_points(pair, now, info) for pair in torsos]
        ends = np.cumsum([len(p) for p in points])
        if not len(ends) or not ends[-1]:
            return [None] * len(torsos)
        pixels = np.concatenate(points)
        earlier, found = _followed(pixels, now, before)
        layers_m = [0.0 if pair is None else pair[1].depth_m for pair in torsos]
        near_m = np.repeat(layers_m, [len(p) for p in points])
        depths_m = _depths(pixels, now, near_m, info), _depths(earlier, before, near_m, info)
        found &= np.isfinite(depths_m[0]) & np.isfinite(depths_m[1])
        dt_s = (now.stamp_ns - before.stamp_ns) / 1e9
        estimates: list[VelocityEstimate | None] = []
        for first, end in zip([0, *ends[:-1]], ends, strict=True):
            own = np.flatnonzero(found[first:end]) + first
            ends_m = depths_m[0][own], depths_m[1][own]
            enough = len(own) >= POINTS_MIN
            estimates.append(
                self._velocity(pixels[own], earlier[own], *ends_m, dt_s, info) if enough else None
            )
        return estimates

    def _velocity(
        self, pixels: F64, earlier: F64, depth_m: F64, earlier_m: F64, dt_s: float, info: CameraInfo
    ) -> VelocityEstimate:
        """Return the middle velocity of points that were followed."""
        config, moved_px = self._config, earlier - pixels
        shift_px, z_m = np.median(moved_px, axis=0), float(np.median(depth_m))
        spread_px = 1.48 * np.median(np.abs(moved_px - shift_px), axis=0)
        middle_px = np.median(pixels, axis=0)
        ends_m = [z_m, z_m - interquartile_mean(depth_m - earlier_m)]
        now_m, before_m = deproject([middle_px, middle_px + shift_px], ends_m, info)
        right_px, down_px = config.sigma_px + config.spread_part * spread_px
        right_mps = right_px * z_m / info.fx / dt_s
        down_mps = down_px * z_m / info.fy / dt_s
        along_mps = config.depth_per_m * z_m**2 / dt_s
        return VelocityEstimate(
            (now_m - before_m) / dt_s,
            covariance(now_m, right_mps**2, down_mps**2, along_mps**2),
        )

    def _is_far(self, before: FlowFrame, now: FlowFrame) -> bool:
        """Check for frames too far apart in time."""
        return abs(now.stamp_ns - before.stamp_ns) > self._config.interval_max_s * 1e9


def interquartile_mean(values: F64) -> float:
    """Return the mean of the middle half of N values.

    Far away depth comes in steps of centimetres: a median is one of them, a mean lies between.
    """
    quarter = len(values) // 4
    return float(np.sort(values)[quarter : len(values) - quarter].mean())


def _points(pair: LayeredTorso | None, now: FlowFrame, info: CameraInfo) -> F64:
    """Return pixels on a torso (Nx2) that are in the person's layer of depth."""
    if pair is None:
        return np.empty((0, 2))
    torso, layer = pair
    box = torso.box_xyxy_px.astype(np.float64)
    left, top, right, bottom = np.tile(box[:2], 2) + np.tile(box[2:] - box[:2], 2) * UPPER_BODY
    if torso.known.all():
        (left, top), (right, bottom) = torso.joints_px.min(axis=0), torso.joints_px.max(axis=0)
        margin = max(MARGIN * (right - left), MARGIN_DOWN * (box[3] - box[1]))
        left, right = left - margin, right + margin
    # Not denser than pixels.
    columns = np.linspace(left, right, min(GRID[0], max(int(right - left), 2)))
    rows = np.linspace(top, bottom, min(GRID[1], max(int(bottom - top), 2)))
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    last = info.width - 2, info.height - 2
    pixels = pixels[((pixels >= 1) & (pixels < last)).all(axis=1)]
    u, v = np.rint(pixels).astype(np.intp).T
    depth_m = now.depth_mm[v, u] / 1000.0
    return np.asarray(pixels[(depth_m > 0) & (np.abs(depth_m - layer.depth_m) < LAYER_M)])


def _followed(pixels: F64, now: FlowFrame, before: FlowFrame) -> tuple[F64, Flags]:
    """Return where pixels (Nx2) were in the frame before, and which (N) were found there."""
    start = pixels.astype(np.float32)[:, None]
    there, found = _flow(now.grey, before.grey, start)
    back, again = _flow(before.grey, now.grey, there)
    error_px = np.linalg.norm((back - start)[:, 0], axis=1)
    return there[:, 0].astype(np.float64), found & again & (error_px < BACK_PX)


def _flow(image: U8, other: U8, start: F32) -> tuple[F32, Flags]:
    """Return where points (Nx1x2) of an image are in another one, and which (N) were found."""
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        image,
        other,
        start,
        start.copy(),  # where they begin
        winSize=(WINDOW_PX, WINDOW_PX),
        maxLevel=LEVELS,
    )
    return np.asarray(there, np.float32), np.asarray(found)[:, 0] > 0


def _depths(pixels: F64, frame: FlowFrame, near_m: F64, info: CameraInfo) -> F64:
    """Return the median depth around pixels (Nx2) of readings near a depth (N), NaN without one."""
    image = DepthImage(frame.depth_mm, info)
    return read_windows(np.nan_to_num(pixels), image, DEPTH_PX, near_m - MOVED_M, near_m + MOVED_M)[
        0
    ]
