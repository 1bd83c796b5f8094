"""Yaws of people by the configured method."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.transport.trace import span
from people4d.messages import F32, F64, U8
from services.detector.config import DetectorConfig
from services.detector.models.base import DetectedPerson
from services.detector.orientation.angle import YawEstimate
from services.detector.orientation.joint import joint_yaws
from services.detector.orientation.network import OrientationNetwork, upper_bodies
from services.detector.orientation.separate import face_rule, separate_yaws
from services.detector.position.surface import DepthImage
from services.detector.position.torso import LayeredTorso


@dataclass(frozen=True, slots=True)
class LayeredPeople:
    """The N people of a frame with keypoints and a layer of depth."""

    indices: Sequence[int]  # N, people of the frame
    keypoints: F32  # Nx17x3
    layers_m: F64  # [m] N
    by_image: F64 | None  # NxA, log likelihood of the yaws by images; None: no network


class OrientationEstimator:
    """Estimates yaws of people, by the method that suits a people model.

    Args:
        config: Configuration of the service.
        model: Name of the people model.
        network: Yaws by images of people; None: yaws by keypoints alone.
    """

    def __init__(
        self, config: DetectorConfig, model: str, network: OrientationNetwork | None
    ) -> None:
        self.method = config.orientation.method
        self._confidence_min = config.confidence_for(model)
        self._face = face_rule(model)
        self._network = network

    def observe(
        self,
        people: Sequence[DetectedPerson],
        torsos: Sequence[LayeredTorso | None],
        rgb: U8,
        image: DepthImage,
    ) -> LayeredPeople | None:
        """Return the people whose yaws the method "joint" estimates; None if there are none.

        The network's inference is a stage of its own: not to be called inside another span.
        """
        known = {
            k: (person.keypoints, torso.layer.depth_m)
            for k, (person, torso) in enumerate(zip(people, torsos, strict=True))
            if person.keypoints is not None and torso is not None
        }
        if self.method == "separate" or not known:
            return None
        keypoints, layers_m = map(np.array, zip(*known.values(), strict=True))
        by_image = None
        if self._network is not None:
            with span("locate"):
                bodies = upper_bodies(rgb, image, keypoints, layers_m)
            by_image = self._network.log_likelihood(bodies)
        return LayeredPeople(list(known), keypoints, layers_m, by_image)

    def estimate(
        self, people: Sequence[DetectedPerson], image: DepthImage, observed: LayeredPeople | None
    ) -> list[YawEstimate | None]:
        """Return the yaws of people, None if unknown; `observed` is the result of `observe`."""
        if self.method == "separate":
            return [self._separate(person, image) for person in people]
        yaws: list[YawEstimate | None] = [None] * len(people)
        if observed is not None:
            found = joint_yaws(observed.keypoints, observed.layers_m, image, observed.by_image)
            for k, yaw in zip(observed.indices, found, strict=True):
                yaws[k] = yaw
        return yaws

    def _separate(self, person: DetectedPerson, image: DepthImage) -> YawEstimate | None:
        if person.keypoints is None:
            return None
        yaws = separate_yaws(person.keypoints, image, self._confidence_min, self._face)
        return yaws.fuse()
