"""People who touch or cross: whose pictures show one person, and what nobody can have done."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from common.messages import F64
from services.tracker import association
from services.tracker.identity_config import ContactConfig
from services.tracker.interface import Measurement, Observation
from services.tracker.population import Target

EDGE_SHARE = 0.01  # of the image's width: so near to its edge a box may be cut off
BOOL = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Scene:
    """What matching has to know of a frame beside people and detections."""

    stamp_ns: int  # [ns]
    c_cos: float  # largest cosine distance of the embedder
    unclear: frozenset[int] = field(default_factory=frozenset)  # detections, see `unclear`

    def clear(self, detections: Sequence[Measurement]) -> BOOL:
        """Tell whose pictures (M) show one person."""
        return np.array([m.index not in self.unclear for m in detections], np.bool_)


def scene(observation: Observation, c_cos: float, config: ContactConfig) -> Scene:
    """Return the scene of a frame."""
    measurements = observation.measurements
    boxes = np.array([m.box_xyxy_px for m in measurements], np.float64).reshape(-1, 4)
    bad = unclear(boxes, observation.size_px, config.covered_max)
    hazy = (m.index for m, is_bad in zip(measurements, bad, strict=True) if is_bad)
    return Scene(observation.stamp_ns, c_cos, frozenset(hazy))


def unclear(boxes: F64, size_px: tuple[int, int] | None, covered_max: float) -> BOOL:
    """Tell which boxes (N) show too much of others or are cut off at the left or right.

    Args:
        boxes: Nx4, xyxy, pixels.
        size_px: Width and height of the image; None: not known.
        covered_max: Share of a box that another one may cover.
    """
    result: BOOL = covered_shares(boxes) > covered_max
    if size_px is not None:
        edge = EDGE_SHARE * size_px[0]
        result |= (boxes[:, 0] < edge) | (boxes[:, 2] > size_px[0] - edge)
    return result


def covered_shares(boxes: F64) -> F64:
    """Return the largest share (N) of each box (Nx4, xyxy, pixels) that another one covers."""
    low = np.maximum(boxes[:, None, :2], boxes[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], boxes[None, :, 2:])
    common = np.prod(np.maximum(high - low, 0.0), axis=-1)
    np.fill_diagonal(common, 0.0)
    shares: F64 = common.max(axis=1, initial=0.0) / np.prod(boxes[:, 2:] - boxes[:, :2], axis=-1)
    return shares


def doubted(
    detections: Sequence[Measurement], observation: Observation, config: ContactConfig
) -> list[Measurement]:
    """Add doubt along the line of sight to detections that others cover.

    The depth of somebody half hidden is often read on whoever stands before them.
    """
    pose = observation.map_from_camera
    if pose is None or config.doubt_sigma_m == 0 or len(detections) < 2:
        return list(detections)
    shares = covered_shares(np.array([m.box_xyxy_px for m in detections], np.float64))
    after = []
    for measurement, share in zip(detections, shares, strict=True):
        ray = measurement.position_m - pose[:3, 3]
        ray /= max(float(np.linalg.norm(ray)), 1e-6)
        doubt_m2 = config.doubt_sigma_m**2 * np.outer(ray, ray)
        doubt = share > config.doubt_covered
        after.append(replace(measurement, doubt_m2=doubt_m2) if doubt else measurement)
    return after


def out_of_reach(
    positions_m: F64, unseen_s: F64, detections: Sequence[Measurement], config: ContactConfig
) -> BOOL:
    """Tell which detections (NxM) are where somebody cannot have walked to.

    Args:
        positions_m: Nx3, predicted; only the ground counts.
        unseen_s: N, seconds since each was seen.
        detections: M; the Mahalanobis distance alone judges those whose depth is in doubt.
        config: What is in reach.
    """
    measured_m = np.array([m.position_m for m in detections])
    gap_m = association.distances(positions_m[:, :2], measured_m[:, :2])
    reach_m = config.jump_m + config.speed_max_mps * unseen_s
    sure = np.array([m.doubt_m2 is None for m in detections])
    return np.asarray((gap_m > reach_m[:, None]) & sure)


def indistinct(d_cos: F64, looks: F64, alike_max: float) -> F64:
    """Return the cosine distances with those of tracks that look alike made equal.

    Appearance cannot tell such tracks apart, so that their positions have to.

    Args:
        d_cos: NxM, of tracks and detections, NaN where unknown.
        looks: NxN, of the tracks among each other, NaN where unknown.
        alike_max: Largest distance of two tracks that look alike.
    """
    alike = np.nan_to_num(looks, nan=np.inf) <= alike_max
    np.fill_diagonal(alike, True)
    shared = np.nan_to_num(d_cos, nan=np.inf)
    for row in np.flatnonzero(alike.sum(axis=1) > 1):
        shared[row] = np.nanmin(d_cos[alike[row]], axis=0, initial=np.inf)
    return np.where(np.isnan(d_cos), d_cos, shared)


def strangers(targets: Sequence[Target], d_cos: F64, clear: BOOL, limit: float) -> BOOL:
    """Tell which clear pictures (NxM) show somebody else than a confirmed track.

    Args:
        targets: N tracks.
        d_cos: NxM cosine distances, NaN where unknown.
        clear: M, whose pictures show one person.
        limit: Largest distance of the same person.
    """
    confirmed = np.array([t.confirmed for t in targets], np.bool_)
    return np.asarray((np.nan_to_num(d_cos) > limit) & confirmed[:, None] & clear)
