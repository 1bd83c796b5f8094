"""People who touch or cross: whose pictures show one person, and what nobody can have done."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from people4d.messages import F64
from services.tracker.config import StrongSort3dConfig
from services.tracker.identity.config import ContactConfig
from services.tracker.interface import Measurement, Observation
from services.tracker.motion.population import Target
from services.tracker.sort3d import association
from services.tracker.strongsort3d.occlusion import NEAR_M, columns, emergence_m, shares

EDGE_SHARE = 0.01  # of the image's width: so near to its edge a box may be cut off
BOOL = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Scene:
    """What matching has to know of a frame beside the people followed."""

    observation: Observation
    c_cos: float  # largest cosine distance of the embedder
    unclear: frozenset[int] = frozenset()  # detections, see `unclear` and `crowded`
    crowded: frozenset[int] = frozenset()  # of these, those that could be of several tracks

    def clear(self, detections: Sequence[Measurement]) -> BOOL:
        """Tell whose pictures (M) show one person."""
        return np.array([m.index not in self.unclear for m in detections], np.bool_)

    def single(self, detections: Sequence[Measurement]) -> BOOL:
        """Tell which detections (M) stand where at most one track is."""
        return np.array([m.index not in self.crowded for m in detections], np.bool_)


def scene(observation: Observation, tracks_m: F64, config: StrongSort3dConfig) -> Scene:
    """Return the scene of a frame.

    Args:
        observation: The frame.
        tracks_m: Nx3, where people are predicted.
        config: What is asked for.
    """
    c_cos = config.cosine_limit(observation.embedder)
    if not (config.contact.enabled or config.identity.enabled):
        return Scene(observation, c_cos)
    measurements = observation.measurements
    boxes = np.array([m.box_xyxy_px for m in measurements], np.float64).reshape(-1, 4)
    many = np.zeros(len(measurements), np.bool_)
    if observation.map_from_camera is not None:
        found_m = np.array([m.position_m for m in measurements]).reshape(-1, 3)
        half_m = config.occlusion.half_width_m
        found, _ = columns(found_m, observation.map_from_camera, half_m)
        tracks, depth_m = columns(tracks_m, observation.map_from_camera, half_m)
        many = crowded(found, tracks[depth_m > NEAR_M], config.contact.shared_min)
    bad = many | unclear(boxes, observation.size_px, config.contact.covered_max)

    def indices(chosen: BOOL) -> frozenset[int]:
        return frozenset(measurements[k].index for k in np.flatnonzero(chosen))

    return Scene(observation, c_cos, indices(bad), indices(many))


def crowded(found: F64, tracks: F64, shared_min: float) -> BOOL:
    """Tell which detections (M) could be of several tracks that stand in one column of the image.

    Of two people, one before the other, often only one is found, or one that is made of both.

    Args:
        found: Mx2, strips of the detections, see `columns`.
        tracks: Nx2, strips where people are predicted.
        shared_min: Share of either strip that the other covers if they could be of one person.
    """
    share = np.maximum(shares(found, tracks), shares(tracks, found).T)
    return np.asarray((share >= shared_min).sum(axis=1) > 1)


def unclear(boxes: F64, size_px: tuple[int, int] | None, covered_max: float) -> BOOL:
    """Tell which boxes (N) show too much of others or are cut off at the left or right.

    Args:
        boxes: Nx4, xyxy, pixels.
        size_px: Width and height of the image; None: not known.
        covered_max: Share of a box that another one may cover.
    """
    result: BOOL = (covered_shares(boxes) > covered_max) | cut_off(boxes, size_px)
    return result


def cut_off(boxes: F64, size_px: tuple[int, int] | None) -> BOOL:
    """Tell which boxes (Nx4, xyxy, pixels) reach the left or right of an image of a size."""
    if size_px is None:
        return np.zeros(len(boxes), np.bool_)
    edge = EDGE_SHARE * size_px[0]
    return np.asarray((boxes[:, 0] < edge) | (boxes[:, 2] > size_px[0] - edge))


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


def in_the_open(
    targets: Sequence[Target],
    tracks_m: F64,
    detections: Sequence[Measurement],
    now: Scene,
    config: StrongSort3dConfig,
) -> BOOL:
    """Tell to which detections (NxM) a hidden person cannot have gone without being seen.

    Whoever is hidden comes out beside those who hide them, or is where they are predicted; from
    there they walk as far as they can since they were hidden last.

    Args:
        targets: N.
        tracks_m: Nx3, where they are predicted.
        detections: M.
        now: The frame.
        config: What is in reach, and how wide people are.
    """
    pose, reach = now.observation.map_from_camera, config.contact
    hidden_s = np.array([(now.observation.stamp_ns - t.hidden_ns) / 1e9 for t in targets])
    here = [t.hidden > 0 and t.camera == now.observation.camera for t in targets]
    if pose is None or not any(here):
        return np.zeros((len(targets), len(detections)), np.bool_)
    found_m = np.array([m.position_m for m in detections])
    out_m = emergence_m(found_m, pose, config.occlusion)
    gap_m = np.minimum(out_m, association.distances(tracks_m[:, :2], found_m[:, :2]))
    far = gap_m > reach.jump_m + reach.speed_max_mps * hidden_s[:, None]
    return np.asarray(far & np.array(here)[:, None])


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
