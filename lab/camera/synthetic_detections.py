"""Detections without images: true keypoints with the errors of a detector, in a millisecond.

The fastest fidelity of the lab, for trackers and later stages. There are occlusions, misses and
false alarms. Positions are on the torso's axis, like the default estimator, or on the surface.
A detection depends on the people, the seed and the stamp only.

"Measured" constants are errors of YOLO11n-pose on simulated people of about 300 px, 3 to 5 m away:
380 of 381 visible people detected, median keypoint error 3.3 px (1.18 standard deviations), twice
as large for ankles. Other values are chosen by eye.
"""

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import Annotated

import numpy as np
from msgspec import Meta

from common.config import Config
from common.geometry.transforms import deproject
from lab.depth.config import DepthSensorModel
from lab.depth.noise import NoiseProcess, Persistence
from lab.truth.silhouette import TORSO, Silhouette, facing, sideways, silhouettes
from people4d.messages import F32, F64, CameraInfo, Detection, Detections
from people4d.messages.base import NonNegative, Positive, Probability
from services.skeleton.body import INSIDE_M

KEY = 0x5169  # key of these random numbers
ANKLE_FACTOR = 1.8  # factor of the noise of ankles; measured
HIDDEN_FACTOR = 3.0  # factor of the noise of hidden keypoints
CONFIDENCE_VISIBLE, CONFIDENCE_HIDDEN = 0.92, 0.35  # mean confidence of keypoints
CONFIDENCE_SIGMA = 0.05  # standard deviation of the confidence
NOISE_S = 0.15  # correlation time of errors [s], see `noise.Persistence`
# Visible shares of the body: full recall above the second, no detection below the first
SHARE_NONE, SHARE_FULL = 0.08, 0.35
HEIGHT_LEAST_PX = 25.0  # minimum height of a detected person [px]
SCORE_NONE, SCORE_FULL = 0.35, 0.9  # mean scores at these shares; the second is measured
SCORE_SIGMA = 0.04  # standard deviation of the score
FALSE_ALARM_S = 0.1  # duration of a false alarm [s]
READINGS = 4  # number of independent depth readings in a position: shoulders and hips
ERRORS, MISSES, FALSE_ALARMS, DEPTHS = range(4)
OCCLUDER_M = 0.3  # distance of the surface in front of a hidden keypoint [m]
SHOULDERS, HIPS, ANKLES = [5, 6], [11, 12], [15, 16]
MIN_SIGMA_RAD = 0.01  # minimum published standard deviation [rad]
MODEL = "geometry"


class SyntheticDetectionsConfig(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Errors of a pose network and of its depth readings."""

    keypoint_share: NonNegative = 0.009  # sigma in x and in y, relative to the height of the box
    keypoint_least_px: NonNegative = 0.5  # [px] minimum standard deviation of a keypoint
    box_share: NonNegative = 0.01  # standard deviation of each side, relative to the box's height
    recall: Probability = 0.99  # share of visible people that are detected
    miss_s: Positive = 0.1  # [s] correlation time of misses
    # Mean number of false alarms in a frame
    false_alarms: Annotated[float, Meta(ge=0, le=100)] = 0.01
    # [m] shift of positions from the torso's axis towards the camera, in front or back view, and in
    # side view; 0.12 and 0.17 for estimators of the surface
    front_m: NonNegative = 0.0
    side_m: NonNegative = 0.0  # [m] see front_m
    no_position: Probability = 0.01  # share of detections without depth
    heading_rad: NonNegative = 0.3  # [rad] standard deviation; measured: median of 11 to 14 deg
    reversals: Probability = 0.03  # share of reversed headings; measured: 0.03
    keypoint_depths: bool = False  # True: the depth at each keypoint
    sensor: DepthSensorModel = DepthSensorModel()  # noise and range of positions


class SyntheticDetections:
    """Simulated detections of known people."""

    def __init__(self, config: SyntheticDetectionsConfig, info: CameraInfo, seed: int) -> None:
        self._config = config
        self._info = info
        self._seed = seed
        self._noises: dict[tuple[int, int], NoiseProcess] = {}

    def at(
        self, people: Sequence[F64], optical_from_map: F64, stamp_ns: int, sequence: int = 0
    ) -> Detections:
        """Return the detections of one frame, highest score first.

        Args:
            people: Keypoints of each person, 17x3, COCO order, frame: map; in constant order.
            optical_from_map: Transform into the camera, 4x4.
            stamp_ns: Stamp of the frame.
            sequence: Sequence number of the frame.
        """
        stamp_s = stamp_ns / 1e9
        up = optical_from_map[:3, 2]
        found = [
            self._detection(
                silhouette,
                up,
                _Errors(self._noise(ERRORS, person).at(stamp_s)),
                self._depths_m(silhouette, person, stamp_s),
            )
            for person, silhouette in silhouettes(
                list(people), optical_from_map, self._info
            ).items()
            if self._is_found(person, silhouette, stamp_s)
        ]
        found += self._false_alarms(stamp_s)
        return Detections(
            stamp_ns=stamp_ns,
            sequence=sequence,
            camera=self._info.camera,
            frame_id=self._info.frame_id,
            model=MODEL,
            width=self._info.width,
            height=self._info.height,
            detections=tuple(sorted(found, key=lambda detection: -detection.score)),
        )

    def _is_found(self, person: int, silhouette: Silhouette, stamp_s: float) -> bool:
        config = self._config
        _, top, _, bottom = silhouette.box_xyxy_px.clip(0, self._edges())
        if bottom - top < HEIGHT_LEAST_PX:
            return False
        probability = config.recall * _visibility(silhouette)
        return NormalDist().cdf(float(self._noise(MISSES, person).at(stamp_s)[0])) < probability

    def _depths_m(self, silhouette: Silhouette, person: int, stamp_s: float) -> F32 | None:
        """Return the depths of the surface at all keypoints, 0 outside of the image."""
        if not self._config.keypoint_depths:
            return None
        pixels, z_m = silhouette.keypoints_px, silhouette.keypoints_m[:, 2]
        slant = np.linalg.norm(silhouette.keypoints_m, axis=1) / z_m
        surface_m = z_m - np.where(silhouette.visible, INSIDE_M / slant, OCCLUDER_M)
        noise = self._noise(DEPTHS, person).at(stamp_s).astype(np.float64)
        read_m = surface_m + noise * [self._config.sensor.noise_m(float(z)) for z in z_m]
        inside = np.all((pixels >= 0) & (pixels < self._edges()[:2]), axis=1) & (surface_m > 0)
        return np.where(inside, read_m, 0.0).astype(np.float32)

    def _detection(
        self, silhouette: Silhouette, up: F64, errors: "_Errors", depths_m: F32 | None
    ) -> Detection:
        config = self._config
        height_px = silhouette.box_xyxy_px[3] - silhouette.box_xyxy_px[1]
        box = silhouette.box_xyxy_px + errors.box * config.box_share * height_px
        sigma_px = np.full(17, max(config.keypoint_share * height_px, config.keypoint_least_px))
        sigma_px[ANKLES] *= ANKLE_FACTOR
        sigma_px[~silhouette.visible] *= HIDDEN_FACTOR
        moved_px = errors.keypoints * sigma_px[:, None]
        mean = np.where(silhouette.visible, CONFIDENCE_VISIBLE, CONFIDENCE_HIDDEN)
        confidence = np.clip(mean + errors.confidences * CONFIDENCE_SIGMA, 0.01, 0.99)
        keypoints = np.column_stack([silhouette.keypoints_px + moved_px, confidence])
        score = SCORE_NONE + (SCORE_FULL - SCORE_NONE) * _visibility(silhouette)
        heading = self._heading(silhouette, up, errors)
        return Detection(
            box_xyxy_px=box.clip(0, self._edges()).astype(np.float32),
            score=float(np.clip(score + errors.score * SCORE_SIGMA, 0.01, 0.99)),
            keypoints=keypoints.astype(np.float32),
            keypoint_depths_m=depths_m,
            position_m=self._position_m(silhouette, moved_px[TORSO].mean(axis=0), errors),
            heading=heading,
            heading_sigma_rad=None if heading is None else max(config.heading_rad, MIN_SIGMA_RAD),
        )

    def _position_m(self, silhouette: Silhouette, moved_px: F64, errors: "_Errors") -> F64 | None:
        """Return the measured position of the torso; None if depth is missing."""
        config = self._config
        torso_m: F64 = silhouette.keypoints_m[TORSO].mean(axis=0)
        lost = NormalDist().cdf(errors.no_position) < config.no_position
        if lost or not silhouette.visible[TORSO].any():
            return None
        side = sideways(silhouette.keypoints_m)
        thick_m = math.hypot(
            config.front_m * math.sqrt(1 - min(side, 1) ** 2), config.side_m * side
        )
        torso_m = torso_m * (1 - thick_m / float(np.linalg.norm(torso_m)))
        sensor, z_m = config.sensor, float(torso_m[2])
        if not sensor.min_depth_m <= z_m <= min(sensor.max_depth_m, self._info.max_depth_m):
            return None
        # Errors of depth are along the ray, errors of pixels across it.
        z_read_m = z_m + errors.depth * sensor.noise_m(z_m) / math.sqrt(READINGS)
        z_read_m *= 1 + sensor.scale_bias
        across_m = moved_px / (self._info.fx, self._info.fy) * z_read_m
        return np.asarray(torso_m * (z_read_m / z_m) + (*across_m, 0.0))

    def _heading(self, silhouette: Silhouette, up: F64, errors: "_Errors") -> F64 | None:
        if not (silhouette.visible[SHOULDERS].all() or silhouette.visible[HIPS].all()):
            return None
        forward = facing(silhouette.keypoints_m, up)
        error_rad = errors.heading * self._config.heading_rad
        if NormalDist().cdf(errors.reversal) < self._config.reversals:
            error_rad += math.pi
        heading: F64 = forward * math.cos(error_rad) + np.cross(up, forward) * math.sin(error_rad)
        return heading

    def _false_alarms(self, stamp_s: float) -> list[Detection]:
        config, info = self._config, self._info
        slot = math.floor(stamp_s / FALSE_ALARM_S) % 2**64
        generator = np.random.default_rng([self._seed, KEY, FALSE_ALARMS, slot])
        alarms = []
        for _ in range(generator.poisson(config.false_alarms)):
            height = generator.uniform(0.15, 0.6) * info.height
            size = np.array([0.4 * height, height])
            begin = generator.uniform(0, (info.width, info.height) - size)
            points = begin + generator.uniform(0, 1, (17, 2)) * size
            z_m = generator.uniform(1.0, min(config.sensor.max_depth_m, info.max_depth_m))
            keypoints = np.column_stack([points, generator.uniform(0.1, 0.6, 17)])
            alarms.append(
                Detection(
                    box_xyxy_px=np.concatenate([begin, begin + size]).astype(np.float32),
                    score=float(generator.uniform(0.3, 0.6)),
                    keypoints=keypoints.astype(np.float32),
                    position_m=deproject(begin + size / 2, z_m, info)[0],
                )
            )
        return alarms

    def _edges(self) -> F64:
        return np.array([self._info.width, self._info.height] * 2, np.float64)

    def _noise(self, kind: int, person: int) -> NoiseProcess:
        if (kind, person) not in self._noises:
            lasts_s = self._config.miss_s if kind == MISSES else NOISE_S
            persistence = Persistence(frozen_share=0.0, correlation_s=lasts_s)
            count = {ERRORS: _Errors.COUNT, DEPTHS: 17}.get(kind, 1)
            seed = (self._seed, KEY, kind, person)
            self._noises[kind, person] = NoiseProcess((count,), seed, persistence)
        return self._noises[kind, person]


def _visibility(silhouette: Silhouette) -> float:
    """Return the visibility of a person: 0 hidden, 1 above `SHARE_FULL`."""
    share = (silhouette.visible_share - SHARE_NONE) / (SHARE_FULL - SHARE_NONE)
    return min(max(share, 0.0), 1.0)


class _Errors:
    """Standard normal errors of one person in one frame."""

    COUNT = 17 * 3 + 4 + 5

    def __init__(self, values: F32) -> None:
        self.keypoints = values[:34].reshape(17, 2).astype(np.float64)
        self.confidences = values[34:51].astype(np.float64)
        self.box = values[51:55].astype(np.float64)
        self.score, self.depth, self.no_position = map(float, values[55:58])
        self.heading, self.reversal = map(float, values[58:60])
