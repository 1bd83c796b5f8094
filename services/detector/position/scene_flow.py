"""Velocities of people by scene flow: motion of the torso's surface since the previous frame.

Pixels of a torso are tracked to the previous image and back by pyramids of [Lucas 1981] around the
person; depth is read at both ends. The median motion over the time between both frames is the
velocity (docs/method.md section 10).
"""

import math
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F64, U8, CameraInfo, RgbdFrame
from services.detector.position.axis import covariance
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
# Points of a square of side 1, Nx2
GRID: F64 = np.stack(
    np.meshgrid(np.linspace(0.0, 1.0, COLUMNS), np.linspace(0.0, 1.0, ROWS)), axis=-1
).reshape(-1, 2)


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


def _velocities(
    pair: FramePair, torsos: Sequence[LayeredTorso]
) -> Iterator[VelocityEstimate | None]:
    """Yield the velocity of each torso.

    Points on two torsos are not used: they may lie on either person.
    """
    areas = np.array([_area(torso.joints) for torso in torsos])
    layers_m = np.array([[torso.layer.depth_m] for torso in torsos])
    sizes_px = areas[:, 2:] - areas[:, :2]
    pixels = areas[:, None, :2] + GRID * sizes_px[:, None]
    depths_m = _depths(pixels, pair.now)
    on = ((pixels[:, :, None] >= areas[:, :2]) & (pixels[:, :, None] <= areas[:, 2:])).all(axis=-1)
    on_others = (on & ~np.eye(len(areas), dtype=np.bool_)[:, None]).any(axis=-1)
    used = (np.abs(depths_m - layers_m) < LAYER_M) & ~on_others
    scales = np.minimum(WIDTH_PX / np.maximum(sizes_px[:, 0], 1.0), 1.0)
    earlier = np.full(pixels.shape, np.nan)
    for k, scale in enumerate(scales):
        if np.count_nonzero(used[k]) >= POINTS_MIN:
            earlier[k, used[k]] = _follow(pixels[k, used[k]], scale, pair)
    moved_m = depths_m - _depths(earlier, pair.before)
    used &= np.abs(depths_m - moved_m - layers_m) < MOVED_M
    motions = np.dstack([pixels, depths_m, earlier - pixels, moved_m])
    for own, points, scale in zip(used, motions, scales, strict=True):
        enough = np.count_nonzero(own) >= POINTS_MIN
        yield _estimate(points[own], SIGMA_PX / scale, pair) if enough else None


def _estimate(points: F64, sigma_px: float, pair: FramePair) -> VelocityEstimate:
    """Return the velocity by points: u, v and depth now, and their motions into the past (Nx6).

    The motion in depth is the mean of the middle half, since distant depth has steps of
    centimetres, which a median keeps. The surface of a swaying or turning body moves relative to
    its axis for about `SURFACE_S`. An independent error of each frame with 2 tau / dt times the
    variance has the same effect.
    """
    info, dt_s, count = pair.info, pair.interval_s, len(points)
    ranked, middle = np.sort(points, axis=0), (count - 1) // 2
    u, v, z_m, right_px, down_px, _ = ranked[middle].tolist()
    along_m = float(ranked[count // 4 : count - count // 4, 5].mean())
    spreads_px = np.sort(np.abs(points[:, 3:5] - (right_px, down_px)), axis=0)[middle]
    pixels = np.array([[u, v], [u + right_px, v + down_px]])
    now_m, before_m = deproject(pixels, [z_m, z_m - along_m], info)
    across_px = sigma_px + SPREAD_PART * 1.48 * spreads_px
    right_mps, down_mps = (across_px * z_m / (info.fx, info.fy) / dt_s).tolist()
    along_mps = DEPTH_PER_M * z_m**2 / dt_s
    surface_m2 = SURFACE_MPS**2 * max(1.0, 2 * SURFACE_S / dt_s)
    variances = (mps**2 + surface_m2 for mps in (right_mps, down_mps, along_mps))
    return VelocityEstimate((now_m - before_m) / dt_s, covariance(now_m, *variances))


def _area(torso: TorsoJoints) -> tuple[float, float, float, float]:
    """Return the torso's rectangle in the image: left, top, right, bottom [px]."""
    left, top, right, bottom = torso.box_xyxy_px.tolist()
    width, height = right - left, bottom - top
    if not torso.known.all():
        first_u, first_v, last_u, last_v = UPPER_BODY
        return (
            left + width * first_u,
            top + height * first_v,
            left + width * last_u,
            top + height * last_v,
        )
    us, vs = zip(*torso.joints_px.tolist(), strict=True)
    margin_px = max(MARGIN * (max(us) - min(us)), MARGIN_DOWN * height)
    return min(us) - margin_px, min(vs), max(us) + margin_px, max(vs)


def _depths(pixels: F64, frame: RgbdFrame) -> F64:
    """Return the depth at pixels (...x2) in metres, NaN outside the image; 0: no reading."""
    height, width = frame.depth_mm.shape
    inside = np.all((pixels >= 0) & (pixels <= (width - 1, height - 1)), axis=-1, keepdims=True)
    u, v = np.moveaxis(np.rint(np.where(inside, pixels, 0)).astype(np.intp), -1, 0)
    return np.where(inside[..., 0], frame.depth_mm[v, u] / 1000.0, np.nan)


def _follow(pixels: F64, scale: float, pair: FramePair) -> F64:
    """Return the pixels (Nx2) in the previous frame, NaN if lost.

    The image is reduced by a scale, which takes a third of the time.
    """
    shape = np.array(pair.now.depth_mm.shape[::-1])
    reach_px = REACH_PX / scale
    first = np.maximum(pixels.min(axis=0) - reach_px, 0).astype(int)
    end = np.minimum(pixels.max(axis=0) + reach_px + 1, shape).astype(int)
    window = np.s_[first[1] : end[1], first[0] : end[0]]
    now, before = (_reduced(frame.rgb[window], scale) for frame in (pair.now, pair.before))
    scales = np.array(now.shape[::-1]) / (end - first)
    start = ((pixels - first + 0.5) * scales - 0.5).astype(np.float32)[:, None]
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        now, before, start, start.copy(), winSize=(WINDOW_PX, WINDOW_PX), maxLevel=LEVELS
    )
    earlier = (there[:, 0] + 0.5) / scales - 0.5 + first
    return np.where(np.asarray(found) > 0, earlier, np.nan)


def _reduced(rgb: U8, scale: float) -> U8:
    """Return an image in grey, reduced by a scale."""
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    if scale < 1:
        grey = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
    return np.asarray(grey, np.uint8)
