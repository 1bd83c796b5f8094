"""Velocities of people by scene flow: motion of the torso's surface since the previous frame.

Pixels of a torso are tracked to the previous image and back by pyramids of [Lucas 1981] around the
person; depth is read at both ends. The median motion over the time between both frames is the
velocity (docs/method.md section 10).
"""

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import cv2
import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F64, U8, CameraInfo, RgbdFrame
from services.detector.position.axis import covariance
from services.detector.position.surface import Flags
from services.detector.position.torso import LayeredTorso
from services.detector.position.torso_samples import TorsoJoints

INTERVAL_MAX_S = 0.25  # maximum time between two compared frames [s]
COLUMNS, ROWS = 5, 8  # grid of points on a torso
MARGIN, MARGIN_DOWN = 0.25, 0.06  # margins relative to the joints' width and the box's height
UPPER_BODY = 0.2, 0.2, 0.8, 0.55  # torso in a box without joints: left, top, right, bottom
WINDOW_PX, LEVELS = 9, 2  # window and pyramid of the optical flow
WIDTH_PX, REACH_PX = 48, 20  # maximum width of a torso, and motion, in the reduced image [px]
POINTS_MIN = 5  # minimum number of points of a velocity
# Maximum distance in depth from the person's layer, in this frame and in both frames [m]
LAYER_M, MOVED_M = 0.3, 0.35
SIGMA_PX, SPREAD_PART = 0.3, 0.7  # error of a motion in the reduced image [px]; part of its spread
DEPTH_PER_M = 0.0032  # error of a motion along the line of sight, divided by z^2 [1/m]
# Standard deviation of the surface's velocity from the axis's [m/s], and its correlation time [s]
SURFACE_MPS, SURFACE_S = 0.1, 0.35
# Points of a square of side 1, 2xP
GRID: F64 = np.array(
    np.meshgrid(np.linspace(0.0, 1.0, COLUMNS), np.linspace(0.0, 1.0, ROWS))
).reshape(2, -1)


@dataclass(frozen=True, slots=True)
class VelocityEstimate:
    """Velocity of a person relative to the camera."""

    velocity_mps: F64  # [m/s] 3, optical frame
    covariance_m2ps2: F64  # 3x3, optical frame


@dataclass(frozen=True, slots=True)
class FramePair:
    """A frame, and the previous frame of the same camera."""

    now: RgbdFrame
    before: RgbdFrame
    info: CameraInfo

    @property
    def interval_s(self) -> float:
        """Time between both frames in seconds."""
        return (self.now.stamp_ns - self.before.stamp_ns) / 1e9


class FrameHistory:
    """Last frame of each camera with a calibration."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._frames: dict[str, RgbdFrame] = {}  # last frames by camera

    def swap_frame(self, frame: RgbdFrame) -> RgbdFrame | None:
        """Store a frame; return the previous one if it is recent and of the same size.

        A late frame of another thread is not stored, unless the clock went back.
        """
        with self._lock:
            before = self._frames.get(frame.camera)
            passed_s = math.inf if before is None else (frame.stamp_ns - before.stamp_ns) / 1e9
            if not -INTERVAL_MAX_S <= passed_s <= 0:
                self._frames[frame.camera] = frame
        if before is None or before.depth_mm.shape != frame.depth_mm.shape:
            return None
        return before if 0 < passed_s <= INTERVAL_MAX_S else None


def measure_velocities(
    pair: FramePair, torsos: Sequence[LayeredTorso | None]
) -> list[VelocityEstimate | None]:
    """Return the velocities of torsos; None with too few tracked points."""
    known = [torso for torso in torsos if torso is not None]
    found = iter(_velocities(pair, known) if known else ())
    return [None if torso is None else next(found) for torso in torsos]


def _velocities(pair: FramePair, torsos: Sequence[LayeredTorso]) -> list[VelocityEstimate | None]:
    """Return the velocity of each torso.

    Points on two torsos are not used: they may lie on either person.
    """
    areas = np.array([_area(torso.joints) for torso in torsos])[..., None]
    layers_m = np.array([[torso.layer.depth_m] for torso in torsos])
    corners, sizes_px = areas[:, :2], areas[:, 2:] - areas[:, :2]
    pixels = corners + GRID * sizes_px
    depths_m = _depths(pixels, pair.now)
    used = ~_on_others(pixels, areas)
    used &= np.abs(depths_m - layers_m) < LAYER_M
    scales = [min(WIDTH_PX / max(width, 1.0), 1.0) for width in sizes_px[:, 0, 0].tolist()]
    earlier = np.full(pixels.shape, np.nan)
    for k in np.flatnonzero(used.sum(axis=1) >= POINTS_MIN).tolist():
        earlier[k][:, used[k]] = _follow(pixels[k][:, used[k]], scales[k], pair)
    moved_m = depths_m - _depths(earlier, pair.before)
    used &= np.abs(depths_m - moved_m - layers_m) < MOVED_M
    points = [pixels, depths_m[:, None], earlier - pixels, moved_m[:, None]]
    enough = (used.sum(axis=1) >= POINTS_MIN).tolist()
    motions = np.where(used[:, None], np.concatenate(points, axis=1), np.nan)[enough]
    sigmas_px = [SIGMA_PX / scale for scale in compress(scales, enough)]
    found = iter(_estimate(motions, sigmas_px, pair))
    return [next(found) if is_enough else None for is_enough in enough]


def _on_others(pixels: F64, areas: F64) -> Flags:
    """Return flags of the pixels (Nx2xP) of each torso in the areas (Nx4x1) of others, NxP."""
    on = (pixels[:, None] >= areas[:, :2]) & (pixels[:, None] <= areas[:, 2:])
    on[np.diag_indices(len(areas))] = False
    return np.asarray((on[:, :, 0] & on[:, :, 1]).any(axis=1))


def _estimate(points: F64, sigmas_px: Sequence[float], pair: FramePair) -> list[VelocityEstimate]:
    """Return velocities by points: u, v and depth now, and their motions into the past (Nx6xP).

    Unused points are NaN. The motion in depth is the mean of the middle half, since distant depth
    has steps of centimetres, which a median keeps. The surface of a swaying or turning body moves
    relative to its axis for about `SURFACE_S`. An independent error of each frame with 2 tau / dt
    times the variance has the same effect.
    """
    info, dt_s, each = pair.info, pair.interval_s, np.arange(len(points))
    counts = np.isfinite(points[:, 0]).sum(axis=1)
    ranked, middles = np.sort(points, axis=2), (counts - 1) // 2
    medians = ranked[each, :, middles]
    first, rank = (counts // 4)[:, None], np.arange(points.shape[2])
    half = np.where((rank >= first) & (rank < counts[:, None] - first), ranked[:, 5], 0.0)
    along_m = half.sum(axis=1) / (counts - 2 * first[:, 0])
    spreads_px = np.sort(np.abs(points[:, 3:5] - medians[:, 3:5, None]), axis=2)[each, :, middles]
    pixels = np.concatenate([medians[:, :2], medians[:, :2] + medians[:, 3:5]])
    z_m = medians[:, 2]
    ends_m = deproject(pixels, np.concatenate([z_m, z_m - along_m]), info)
    now_m = ends_m[: len(points)]
    velocities_mps = (now_m - ends_m[len(points) :]) / dt_s
    surface_m2 = SURFACE_MPS**2 * max(1.0, 2 * SURFACE_S / dt_s)
    estimates = []
    for velocity_mps, now, sigma_px, spread_px in zip(
        velocities_mps, now_m.tolist(), sigmas_px, spreads_px.tolist(), strict=True
    ):
        right_mps, down_mps = (
            (sigma_px + SPREAD_PART * 1.48 * spread) * now[2] / focal_px / dt_s
            for spread, focal_px in zip(spread_px, (info.fx, info.fy), strict=True)
        )
        along_mps = DEPTH_PER_M * now[2] ** 2 / dt_s
        variances = (mps**2 + surface_m2 for mps in (right_mps, down_mps, along_mps))
        estimates.append(VelocityEstimate(velocity_mps, covariance(now, *variances)))
    return estimates


def _area(torso: TorsoJoints) -> tuple[float, float, float, float]:
    """Return the torso's rectangle in the image: left, top, right, bottom [px]."""
    left, top, right, bottom = torso.box_xyxy_px
    width, height = right - left, bottom - top
    if not all(torso.known):
        first_u, first_v, last_u, last_v = UPPER_BODY
        return (
            left + width * first_u,
            top + height * first_v,
            left + width * last_u,
            top + height * last_v,
        )
    us, vs = zip(*torso.joints_px, strict=True)
    margin_px = max(MARGIN * (max(us) - min(us)), MARGIN_DOWN * height)
    return min(us) - margin_px, min(vs), max(us) + margin_px, max(vs)


def _depths(pixels: F64, frame: RgbdFrame) -> F64:
    """Return the depth at pixels (Nx2xP) in metres, NaN outside the image; 0: no reading."""
    u, v = pixels[:, 0], pixels[:, 1]
    height, width = frame.depth_mm.shape
    inside = (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
    columns, rows = np.rint(np.where(inside[:, None], pixels, 0)).astype(np.intp).swapaxes(0, 1)
    return np.where(inside, frame.depth_mm[rows, columns] / 1000.0, np.nan)


def _follow(pixels: F64, scale: float, pair: FramePair) -> F64:
    """Return the pixels (2xP) in the previous frame, NaN if lost.

    The image is reduced by a scale, which takes a third of the time.
    """
    height, width = pair.now.depth_mm.shape
    reach_px = REACH_PX / scale
    (left, top), (right, bottom) = pixels.min(axis=1).tolist(), pixels.max(axis=1).tolist()
    first_u, first_v = int(max(left - reach_px, 0)), int(max(top - reach_px, 0))
    end_u, end_v = int(min(right + reach_px + 1, width)), int(min(bottom + reach_px + 1, height))
    window = np.s_[first_v:end_v, first_u:end_u]
    now, before = (_reduced(frame.rgb[window], scale) for frame in (pair.now, pair.before))
    scales = (now.shape[1] / (end_u - first_u), now.shape[0] / (end_v - first_v))
    shift = 0.5 - np.array((first_u, first_v))
    start = ((pixels.T + shift) * scales - 0.5).astype(np.float32)[:, None]
    there, found, _ = cv2.calcOpticalFlowPyrLK(  # type: ignore[call-overload]  # no guess
        now, before, start, None, winSize=(WINDOW_PX, WINDOW_PX), maxLevel=LEVELS
    )
    there[found[:, 0] == 0] = np.nan
    earlier: F64 = ((there[:, 0] + 0.5) / scales - shift).T
    return earlier


def _reduced(rgb: U8, scale: float) -> U8:
    """Return an image in grey, reduced by a scale."""
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    if scale < 1:
        grey = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
    return np.asarray(grey, np.uint8)
