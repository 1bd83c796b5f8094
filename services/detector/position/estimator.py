"""Positions of people by the configured method."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from people4d.messages import F64
from services.detector.config import DetectorConfig
from services.detector.models.base import DetectedPerson
from services.detector.position.axis import (
    BODY,
    axis_sigma,
    covariance,
    move_to_axis,
    variance_along,
    variances_across,
)
from services.detector.position.surface import (
    DepthImage,
    PositionEstimate,
    keypoint_depth,
    keypoint_mean,
    mask_centroid,
)
from services.detector.position.torso import LayeredTorso, TorsoEstimator


class PositionEstimator:
    """Estimates positions of people from depth, by the method that suits a people model."""

    def __init__(self, config: DetectorConfig, model: str) -> None:
        self._config = config
        self._confidence_min = config.confidence_for(model)
        self._ellipse = BODY if config.to_axis else None
        self._torso = TorsoEstimator(self._ellipse, config.depth_error_per_m)

    def find_torsos(
        self, people: Sequence[DetectedPerson], image: DepthImage
    ) -> list[LayeredTorso | None]:
        """Return the torsos of people, or None, see `TorsoEstimator.find_torsos`."""
        return self._torso.find_torsos(people, self._confidence_min, image)

    def estimate(
        self,
        people: Sequence[DetectedPerson],
        torsos: Sequence[LayeredTorso | None],
        image: DepthImage,
        yaws_rad: Sequence[float | None],
    ) -> list[PositionEstimate | None]:
        """Return the positions of people, yaws in the camera's frame; None if depth is invalid.

        The torsos, from `find_torsos`, are needed for the method "torso" only.
        """
        if self._config.position != "torso":
            pairs = zip(people, yaws_rad, strict=True)
            positions = [self._from_surface(person, image, yaw_rad) for person, yaw_rad in pairs]
        else:
            positions = self._torso.estimate(torsos, image.info, yaws_rad)
            for k, (person, yaw_rad) in enumerate(zip(people, yaws_rad, strict=True)):
                if person.keypoints is None and person.mask is not None:
                    positions[k] = self._torso.estimate_from_mask(person.mask, image, yaw_rad)
        if self._config.covariance:
            return positions
        return [position and replace(position, covariance_m2=None) for position in positions]

    def _from_surface(
        self, person: DetectedPerson, image: DepthImage, yaw_rad: float | None
    ) -> PositionEstimate | None:
        """Return the position on the visible surface [PIC4SeR], regardless of other people."""
        mask, keypoints = person.mask, person.keypoints
        point_m, readings_m = None, [0.0]
        if self._config.position != "keypoints":
            point_m = None if mask is None else mask_centroid(mask, image)
        elif keypoints is not None:
            point_m = keypoint_mean(keypoints, image, self._confidence_min)
            depth_m = keypoint_depth(keypoints, image, self._confidence_min)
            readings_m = depth_m[np.isfinite(depth_m)].tolist()
        if point_m is None:
            return None
        if self._ellipse:
            point_m = move_to_axis(point_m, yaw_rad, self._ellipse)
        return PositionEstimate(point_m, self._covariance(point_m, readings_m, image, yaw_rad))

    def _covariance(
        self, point_m: F64, readings_m: Sequence[float], image: DepthImage, yaw_rad: float | None
    ) -> F64:
        z_m, sigma_m = float(point_m[2]), axis_sigma(self._ellipse, yaw_rad)
        along_m2 = variance_along(z_m, readings_m, sigma_m, self._config.depth_error_per_m)
        return covariance(point_m.tolist(), *variances_across(z_m, image.info), along_m2)
