"""Torsos of people: their joints in the image and the layer of depth that they are in.

Depth is read in windows on the torso, off its outline, at other keypoints and in the visible area;
readings of other people, a wall or an occluder are in other layers (docs/method.md section 10).
"""

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from services.detector.models.base import DetectedPerson
from services.detector.position.layers import PersonLayer, assign_layers
from services.detector.position.surface import DepthImage, DepthWindows
from services.detector.position.torso_samples import (
    TorsoJoints,
    depth_samples,
    sampled_torsos,
    window_side,
)


class LayeredTorso(NamedTuple):
    """Torso of one person, and the layer of depth that it is in."""

    joints: TorsoJoints
    layer: PersonLayer


def find_torsos(
    people: Sequence[DetectedPerson], confidence_min: float, image: DepthImage
) -> list[LayeredTorso | None]:
    """Return the torso of each person of a frame, and its layer of depth.

    Keypoints above the minimum confidence and inside the image count; without keypoints the box
    does. None if depth of the person is missing.
    """
    if not people:
        return []
    torsos = sampled_torsos(people, confidence_min, image.info)
    pixels = [[*torso.torso_px, *torso.others_px] for torso in torsos]
    sides_px = np.repeat(
        [window_side(torso.joints.diagonal_px) for torso in torsos], [*map(len, pixels)]
    )
    windows_px = np.array(list(chain(*pixels))).reshape(-1, 2)
    windows = DepthWindows(windows_px, image, sides_px)
    layers = assign_layers(depth_samples(torsos, windows_px, windows, image))
    return [
        None if layer is None else LayeredTorso(torso.joints, layer)
        for torso, layer in zip(torsos, layers, strict=True)
    ]
