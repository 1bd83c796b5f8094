"""Detections without pictures: true keypoints with the errors of a detector, in a millisecond.

The fastest of the lab's three speeds, for trackers and all that follows. People hide one another
and are missed, there are false alarms, and positions lie on the surface that faces the camera, as
depth has them. A sighting depends on the people, the seed and the stamp only.
"""

import math
from collections.abc import Sequence
from statistics import NormalDist

import numpy as np

from common.geometry.transforms import deproject
from lab.depth.noise import Drift, Persistence
from lab.outline import TORSO, Outline, facing, outlines, sideways
from lab.sighting_config import SightingConfig
from people4d.messages import F32, F64, CameraInfo, Detection, Detections

KEY = 0x5169  # sets these random numbers apart from others of the same seed
ERRORS, MISSES, FALSE_ALARMS = range(3)
SHOULDERS, HIPS, ANKLES = [5, 6], [11, 12], [15, 16]
SURE_RAD = 0.01  # smallest standard deviation that is told
MODEL = "geometry"


class Sightings:
    """Tells where a detector would have found people.

    Args:
        config: How it errs.
        info: Calibration of the camera.
        seed: Of its random numbers.
    """

    def __init__(self, config: SightingConfig, info: CameraInfo, seed: int) -> None:
        self._config = config
        self._info = info
        self._seed = seed
        self._drifts: dict[tuple[int, int], Drift] = {}

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
            self._detection(outline, up, _Errors(self._drift(ERRORS, person).at(stamp_s)))
            for person, outline in outlines(list(people), optical_from_map, self._info).items()
            if self._is_found(person, outline, stamp_s)
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

    def _is_found(self, person: int, outline: Outline, stamp_s: float) -> bool:
        config = self._config
        _, top, _, bottom = outline.box_xyxy_px.clip(0, self._edges())
        if bottom - top < config.height_least_px:
            return False
        chance = config.recall * self._clearness(outline)
        return NormalDist().cdf(float(self._drift(MISSES, person).at(stamp_s)[0])) < chance

    def _detection(self, outline: Outline, up: F64, errors: "_Errors") -> Detection:
        config = self._config
        height_px = outline.box_xyxy_px[3] - outline.box_xyxy_px[1]
        box = outline.box_xyxy_px + errors.box * config.box_share * height_px
        sigma_px = np.full(17, max(config.keypoint_share * height_px, config.keypoint_least_px))
        sigma_px[ANKLES] *= config.ankle_factor
        sigma_px[~outline.visible] *= config.hidden_factor
        moved_px = errors.keypoints * sigma_px[:, None]
        mean = np.where(outline.visible, config.confidence_seen, config.confidence_hidden)
        confidence = np.clip(mean + errors.confidences * config.confidence_sigma, 0.01, 0.99)
        keypoints = np.column_stack([outline.keypoints_px + moved_px, confidence])
        worst, best = config.score_none, config.score_full
        score = worst + (best - worst) * self._clearness(outline)
        heading = self._heading(outline, up, errors)
        return Detection(
            box_xyxy_px=box.clip(0, self._edges()).astype(np.float32),
            score=float(np.clip(score + errors.score * config.score_sigma, 0.01, 0.99)),
            keypoints=keypoints.astype(np.float32),
            position_m=self._position_m(outline, moved_px[TORSO].mean(axis=0), errors),
            heading=heading,
            heading_sigma_rad=None if heading is None else max(config.heading_rad, SURE_RAD),
        )

    def _position_m(self, outline: Outline, moved_px: F64, errors: "_Errors") -> F64 | None:
        """Return the mean of the torso's surface as depth has it, None where it has none."""
        config = self._config
        torso_m: F64 = outline.keypoints_m[TORSO].mean(axis=0)
        lost = NormalDist().cdf(errors.no_position) < config.no_position
        if lost or not outline.visible[TORSO].any():
            return None
        side = sideways(outline.keypoints_m)
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
        position_m: F64 = torso_m * (z_read_m / z_m) + (*across_m, 0.0)
        return position_m

    def _heading(self, outline: Outline, up: F64, errors: "_Errors") -> F64 | None:
        """Return the way the chest faces, None if neither shoulders nor hips are seen."""
        if not (outline.visible[SHOULDERS].all() or outline.visible[HIPS].all()):
            return None
        forward = facing(outline.keypoints_m, up)
        error_rad = errors.heading * self._config.heading_rad
        if NormalDist().cdf(errors.reversal) < self._config.reversals:
            error_rad += math.pi
        heading: F64 = forward * math.cos(error_rad) + np.cross(up, forward) * math.sin(error_rad)
        return heading

    def _clearness(self, outline: Outline) -> float:
        """Return how well a person is seen: 0 not at all, 1 from `share_full` on."""
        none, full = self._config.share_none, self._config.share_full
        return min(max((outline.visible_share - none) / (full - none), 0.0), 1.0)

    def _false_alarms(self, stamp_s: float) -> list[Detection]:
        """Return detections of nobody; they stay in place while they last."""
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
        """Return the largest values of a box in the image."""
        return np.array([self._info.width, self._info.height] * 2, np.float64)

    def _drift(self, kind: int, person: int) -> Drift:
        if (kind, person) not in self._drifts:
            lasts_s = self._config.noise_s if kind == ERRORS else self._config.miss_s
            lasting = Persistence(frozen_share=0.0, correlation_s=lasts_s)
            count = _Errors.COUNT if kind == ERRORS else 1
            seed = (self._seed, KEY, kind, person)
            self._drifts[kind, person] = Drift((count,), seed, lasting)
        return self._drifts[kind, person]


class _Errors:
    """Standard normal numbers of one person in one frame, by what they make wrong."""

    COUNT = 17 * 3 + 4 + 5

    def __init__(self, values: F32) -> None:
        self.keypoints = values[:34].reshape(17, 2).astype(np.float64)
        self.confidences = values[34:51].astype(np.float64)
        self.box = values[51:55].astype(np.float64)
        self.score, self.depth, self.no_position = map(float, values[55:58])
        self.heading, self.reversal = map(float, values[58:60])
