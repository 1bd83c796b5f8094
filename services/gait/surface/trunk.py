"""Where the trunk is: the source of distances along the body."""

import numpy as np

from people4d.messages import F32, F64
from services.gait.points.config import DepthLayerConfig
from services.gait.points.limbs import trunk_vertices
from services.gait.points.points import torso_pixel
from services.gait.surface.mesh import Surface
from services.gait.surface.spin_image import similarity, spin_images

CANDIDATES = 24
NEAR_M = 0.08  # [m] of candidates about the trunk's middle, standard deviation
KEEP = 0.95  # of the reference in each frame; the rest is of the new one


class Trunk:
    """Finds the same place on the trunk in each frame, by its spin image.

    The trunk is nearly rigid, so its spin image lasts, which that of a hand does not. It changes as
    the person turns: the reference follows slowly, and the place stays about the trunk's middle.

    Args:
        config: Spin images.
    """

    def __init__(self, config: DepthLayerConfig) -> None:
        self._config = config
        self._reference: F64 | None = None

    def vertex(
        self, surface: Surface, heights_m: F64, stature_m: float, keypoints: F32 | None
    ) -> int:
        """Return the vertex at the middle of the trunk."""
        config = self._config
        pixel = torso_pixel(keypoints, config) if config.keypoints else None
        trunk = trunk_vertices(heights_m, stature_m)
        if pixel is None:
            pixel = np.median(surface.pixels_px[trunk], axis=0)
        away = np.linalg.norm(surface.pixels_px[trunk] - pixel, axis=1)
        middle = trunk[int(np.argmin(away))]
        places = surface.points_m[trunk]
        near = np.linalg.norm(places - surface.points_m[middle], axis=1)
        nearest = trunk[np.argsort(near, kind="stable")]
        nearest = nearest[np.sort(near) < 2 * NEAR_M]
        candidates = nearest[:: max(1, len(nearest) // CANDIDATES)]
        images = spin_images(surface, candidates, config.spin)
        if self._reference is None:
            self._reference = images[0]
            return int(middle)
        off = np.linalg.norm(surface.points_m[candidates] - surface.points_m[middle], axis=1)
        scores = similarity(images, self._reference) / config.spin_sigma
        best = int(np.argmax(np.maximum(scores, -20.0) - 0.5 * (off / NEAR_M) ** 2))
        self._reference = KEEP * self._reference + (1 - KEEP) * images[best]
        return int(candidates[best])
