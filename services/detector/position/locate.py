"""Where people are, by the configured method."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from people4d.messages import F64
from services.detector.config import DetectorConfig
from services.detector.models.base import Person
from services.detector.position.certainty import along_m2, axis_sigma, covariance
from services.detector.position.layers import Layer
from services.detector.position.position import (
    Place,
    Sight,
    keypoint_depth,
    keypoint_mean,
    mask_centroid,
)
from services.detector.position.torso import Torso, TorsoReader
from services.detector.position.trunk import move_to_axis

Settled = tuple[Torso, Layer]


class Locator:
    """Reads the positions of people from depth.

    Args:
        config: The method and its constants.
        model: Name of the people model.
    """

    def __init__(self, config: DetectorConfig, model: str) -> None:
        self._config = config
        self._rule = config.keypoint_rule(model)
        self._trunk = config.trunk if config.to_axis else None
        self._torso = TorsoReader(config.torso, self._trunk, config.certainty)

    def settled(self, people: Sequence[Person], sight: Sight) -> list[Settled | None]:
        """Return the torsos of the people of a frame, each with the layer of depth that it is in.

        Args:
            people: Where they were found in the image.
            sight: Depth and calibration.

        Returns:
            None for people without keypoints, and where depth does not tell.
        """
        points = [p.keypoints for p in people if p.keypoints is not None]
        sights = [sight] * len(points)
        found = iter(self._torso.settled(points, self._rule.confidence_min, sights))
        return [None if person.keypoints is None else next(found) for person in people]

    def places(
        self,
        people: Sequence[Person],
        sights: Sequence[Sight],
        settled: Sequence[Settled | None] | None = None,
    ) -> list[Place | None]:
        """Return where the people of a frame are; None where depth does not tell.

        Args:
            people: Where they were found in the image.
            sights: Depth, calibration and the way each of them faces.
            settled: Their torsos, if they are at hand.
        """
        if self._config.position == "torso":
            settled = self.settled(people, sights[0]) if settled is None and people else settled
            places = [
                self._torso_place(*one) for one in zip(people, sights, settled or (), strict=True)
            ]
        else:
            places = [self._point(*pair) for pair in zip(people, sights, strict=True)]
        if self._config.covariance:
            return places
        return [None if p is None else replace(p, covariance_m2=None) for p in places]

    def _torso_place(self, person: Person, sight: Sight, settled: Settled | None) -> Place | None:
        """Return a place by joints, else by the mask."""
        if person.keypoints is not None:
            return None if settled is None else self._torso.place(*settled, sight)
        return None if person.mask is None else self._torso.mask(person.mask, sight)

    def _point(self, person: Person, sight: Sight) -> Place | None:
        """Return the place by the paper's methods, which take each person alone."""
        method, mask, keypoints = self._config.position, person.mask, person.keypoints
        point_m, readings_m = None, np.empty(0)
        if method != "keypoints" and mask is not None:
            point_m = mask_centroid(mask, sight.depth_mm, sight.info)
            readings_m = np.zeros(1)
        elif method in ("auto", "keypoints") and keypoints is not None:
            point_m = keypoint_mean(keypoints, sight.depth_mm, sight.info, self._rule)
            if self._config.covariance:
                depth_m = keypoint_depth(keypoints, sight.depth_mm, sight.info, self._rule)
                readings_m = depth_m[np.isfinite(depth_m)]
        return None if point_m is None else self._surface(point_m, readings_m, sight)

    def _surface(self, point_m: F64, readings_m: F64, sight: Sight) -> Place:
        """Return the place of a point that was read on the surface."""
        rule = self._config.certainty
        if self._trunk:
            point_m = move_to_axis(point_m, sight.yaw_rad, self._trunk)
        if not self._config.covariance:
            return Place(point_m)
        z_m = float(point_m[2])
        pixel_m2 = (rule.joint_px * z_m / sight.info.fx) ** 2
        along = along_m2(z_m, readings_m, axis_sigma(self._trunk, sight.yaw_rad, rule), rule)
        across = rule.centroid_m**2 + pixel_m2, rule.centroid_down_m**2 + pixel_m2
        return Place(point_m, covariance(point_m, *across, along))
