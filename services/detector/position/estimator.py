"""Positions of people by the configured method."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from common.transport.trace import span
from people4d.messages import F64, U8
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
from services.detector.position.body import BodyNetwork
from services.detector.position.surface import (
    DepthImage,
    PositionEstimate,
    keypoint_depth,
    keypoint_mean,
    mask_centroid,
)
from services.detector.position.torso import LayeredTorso


class PositionEstimator:
    """Estimates positions of people from depth, by the method that suits a people model.

    Args:
        config: Configuration of the service.
        model: Name of the people model.
        network: Positions by images of people; None: the method needs none.

    Raises:
        ValueError: The method "network" has no network.
    """

    def __init__(self, config: DetectorConfig, model: str, network: BodyNetwork | None) -> None:
        if config.position == "network" and network is None:
            raise ValueError('position "network": the body network is missing')
        self._config = config
        self._confidence_min = config.confidence_for(model)
        self._ellipse = BODY if config.to_axis else None
        self._network = network if config.position == "network" else None

    def observe(
        self, torsos: Sequence[LayeredTorso | None], rgb: U8, image: DepthImage
    ) -> list[PositionEstimate | None]:
        """Return the positions of people by the network; None without a layer or a network.

        The network's inference is a stage of its own: not to be called inside another span.
        """
        known = [torso for torso in torsos if torso is not None]
        if self._network is None or not known:
            return [None] * len(torsos)
        with span("locate"):
            boxes = np.array([torso.joints.box_xyxy_px for torso in known])
            candidates = self._network.candidates(
                boxes, np.array([torso.layer.depth_m for torso in known]), rgb, image
            )
        bodies = iter(self._network.observe(candidates))
        return [None if torso is None else next(bodies) for torso in torsos]

    def estimate(
        self,
        people: Sequence[DetectedPerson],
        bodies: Sequence[PositionEstimate | None],
        image: DepthImage,
        yaws_rad: Sequence[float | None],
    ) -> list[PositionEstimate | None]:
        """Return the positions of people, yaws in the camera's frame; None if depth is invalid.

        The bodies, from `observe`, are needed for the method "network" only.
        """
        if self._network is not None:
            positions = list(bodies)
        else:
            pairs = zip(people, yaws_rad, strict=True)
            positions = [self._from_surface(person, image, yaw_rad) for person, yaw_rad in pairs]
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
