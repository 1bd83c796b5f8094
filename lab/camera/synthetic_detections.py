"""Detections without images: true keypoints with the errors of a detector, in a millisecond.

The fastest fidelity of the lab, for trackers and all that follows. People hide one another and are
missed, and there are false alarms. Positions are those of the torso's axis, as the default
estimator gives them, or of the surface that faces the camera. A detection depends on the people,
the seed and the stamp only.
"""

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import Annotated

import numpy as np
from msgspec import Meta

from common.config import Config
from common.geometry.transforms import deproject
from lab.depth.config import DepthSensorConfig
from lab.depth.noise import NoiseProcess, Persistence
from lab.truth.silhouette import TORSO, Silhouette, facing, sideways, silhouettes
from people4d.messages import F32, F64, CameraInfo, Detection, Detections
from people4d.messages.base import NonNegative, Positive, PositiveInt, Probability, Ratio

KEY = 0x5169  # sets these random numbers apart from others of the same seed
ERRORS, MISSES, FALSE_ALARMS = range(3)
SHOULDERS, HIPS, ANKLES = [5, 6], [11, 12], [15, 16]
MIN_SIGMA_RAD = 0.01  # smallest standard deviation that is published
MODEL = "geometry"


class SyntheticDetectionsConfig(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Errors of a pose network and of the depth it is read with.

    "Measured" is what YOLO11n-pose did on drawn people of about 300 px, 3 to 5 m away: 380 of 381
    who were not hidden found, median keypoint error 3.3 px (1.18 standard deviations), ankles twice
    that. Other values are by eye.
    """

    keypoint_share: NonNegative = 0.009  # sigma in x and in y, of the box's height; measured
    keypoint_least_px: NonNegative = 0.5  # [px] standard deviation that is always there
    ankle_factor: NonNegative = 1.8  # ankles are worse by this; measured
    hidden_factor: NonNegative = 3.0  # keypoints that are hidden, and guessed, are worse by this
    confidence_visible: Ratio = 0.92  # mean confidence of visible keypoints
    confidence_hidden: Ratio = 0.35  # and of those that are hidden or outside of the image
    confidence_sigma: NonNegative = 0.05  # standard deviation of both
    box_share: NonNegative = 0.01  # standard deviation of each side of the box, of its height
    noise_s: Positive = 0.15  # [s] how long errors last, see `noise.Persistence.correlation_s`
    recall: Probability = 0.99  # share of people found who are not hidden; measured: 0.99 to 1
    share_full: Ratio = 0.35  # visible share of the body from which they are found so often
    share_none: Ratio = 0.08  # visible share up to which a person is missed; linear between
    height_least_px: NonNegative = 25.0  # [px] smaller people are not found
    miss_s: Positive = 0.1  # [s] how long a miss lasts
    score_full: Ratio = 0.9  # mean score of people from `share_full` on; measured
    score_none: Ratio = 0.35  # mean score at `share_none`; linear between
    score_sigma: NonNegative = 0.04  # standard deviation of both
    false_alarms: Annotated[float, Meta(ge=0, le=100)] = 0.01  # mean a frame; measured: 0 to 0.01
    false_alarm_s: Positive = 0.1  # [s] that a false alarm stays
    # [m] from the torso's axis towards the camera, seen from the front or the back, and from the
    # side; 0.12 and 0.17 for estimators that stay on the surface
    front_m: NonNegative = 0.0
    side_m: NonNegative = 0.0
    readings: PositiveInt = 4  # independent readings of depth in a position: shoulders and hips
    no_position: Probability = 0.01  # share of people found whose depth cannot be read
    heading_rad: NonNegative = 0.3  # [rad] sigma; measured: half of all within 11 to 14 deg
    reversals: Probability = 0.03  # share of headings that are turned round; measured: 0.03
    sensor: DepthSensorConfig = DepthSensorConfig()  # whose noise and range positions have

    def __post_init__(self) -> None:
        """Check the visible shares against each other."""
        super().__post_init__()
        if not self.share_none < self.share_full:
            raise ValueError("share_none, share_full: expected none < full")


class SyntheticDetections:
    """Detections that a detector would have made of known people."""

    def __init__(self, config: SyntheticDetectionsConfig, info: CameraInfo, seed: int) -> None:
        self._config = config
        self._info = info
        self._seed = seed
        self._noises: dict[tuple[int, int], NoiseProcess] = {}

    def at(
        self, people: Sequence[F64], optical_from_map: F64, stamp_ns: int, sequence: int = 0
    ) -> Detections:
        """Return the detections of one frame, best score first.

        Args:
            people: 17x3 keypoints of each, COCO order, frame: map; always in the same order.
            optical_from_map: 4x4.
            stamp_ns: Of the frame.
            sequence: Of the frame.
        """
        stamp_s = stamp_ns / 1e9
        up = optical_from_map[:3, 2]
        found = [
            self._detection(silhouette, up, _Errors(self._noise(ERRORS, person).at(stamp_s)))
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
        if bottom - top < config.height_least_px:
            return False
        probability = config.recall * self._visibility(silhouette)
        return NormalDist().cdf(float(self._noise(MISSES, person).at(stamp_s)[0])) < probability

    def _detection(self, silhouette: Silhouette, up: F64, errors: "_Errors") -> Detection:
        config = self._config
        height_px = silhouette.box_xyxy_px[3] - silhouette.box_xyxy_px[1]
        box = silhouette.box_xyxy_px + errors.box * config.box_share * height_px
        sigma_px = np.full(17, max(config.keypoint_share * height_px, config.keypoint_least_px))
        sigma_px[ANKLES] *= config.ankle_factor
        sigma_px[~silhouette.visible] *= config.hidden_factor
        moved_px = errors.keypoints * sigma_px[:, None]
        mean = np.where(silhouette.visible, config.confidence_visible, config.confidence_hidden)
        confidence = np.clip(mean + errors.confidences * config.confidence_sigma, 0.01, 0.99)
        keypoints = np.column_stack([silhouette.keypoints_px + moved_px, confidence])
        worst, best = config.score_none, config.score_full
        score = worst + (best - worst) * self._visibility(silhouette)
        heading = self._heading(silhouette, up, errors)
        return Detection(
            box_xyxy_px=box.clip(0, self._edges()).astype(np.float32),
            score=float(np.clip(score + errors.score * config.score_sigma, 0.01, 0.99)),
            keypoints=keypoints.astype(np.float32),
            position_m=self._position_m(silhouette, moved_px[TORSO].mean(axis=0), errors),
            heading=heading,
            heading_sigma_rad=None if heading is None else max(config.heading_rad, MIN_SIGMA_RAD),
        )

    def _position_m(self, silhouette: Silhouette, moved_px: F64, errors: "_Errors") -> F64 | None:
        """Return the position of the torso as depth has it, None where it has none."""
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
        # A wrong reading lies on the ray of its pixel, and a wrong pixel on another ray.
        z_read_m = z_m + errors.depth * sensor.noise_m(z_m) / math.sqrt(config.readings)
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

    def _visibility(self, silhouette: Silhouette) -> float:
        """Return the visibility of a person: 0 hidden, 1 from `share_full` on."""
        none, full = self._config.share_none, self._config.share_full
        return min(max((silhouette.visible_share - none) / (full - none), 0.0), 1.0)

    def _false_alarms(self, stamp_s: float) -> list[Detection]:
        config, info = self._config, self._info
        slot = math.floor(stamp_s / config.false_alarm_s) % 2**64
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
            lasts_s = self._config.noise_s if kind == ERRORS else self._config.miss_s
            persistence = Persistence(frozen_share=0.0, correlation_s=lasts_s)
            count = _Errors.COUNT if kind == ERRORS else 1
            seed = (self._seed, KEY, kind, person)
            self._noises[kind, person] = NoiseProcess((count,), seed, persistence)
        return self._noises[kind, person]


class _Errors:
    """Standard normal numbers of one person in one frame, by the value they change."""

    COUNT = 17 * 3 + 4 + 5

    def __init__(self, values: F32) -> None:
        self.keypoints = values[:34].reshape(17, 2).astype(np.float64)
        self.confidences = values[34:51].astype(np.float64)
        self.box = values[51:55].astype(np.float64)
        self.score, self.depth, self.no_position = map(float, values[55:58])
        self.heading, self.reversal = map(float, values[58:60])
