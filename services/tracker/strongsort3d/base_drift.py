"""What a base that drives adds to the doubt about where people are: its odometry drifts."""

import numpy as np

from common.geometry.transform_history import TransformBufferConfig, displacement
from common.geometry.transforms import invert
from people4d.messages import F64
from services.tracker.interface import Observation


class BaseDrift:
    """How far people may seem to have moved because the base erred about its own motion.

    The errors of way and of turn grow as a random walk with the way and with the angle; a turn by
    angle e about the vertical moves whoever is r away by e r, at right angles to the way there.

    Args:
        config: How odometry errs.
    """

    def __init__(self, config: TransformBufferConfig) -> None:
        self._config = config
        self._poses: dict[str, F64] = {}

    def since_last(self, observation: Observation, places_m: F64) -> F64 | None:
        """Return the covariances that have come up since the camera's last frame.

        Args:
            observation: The frame.
            places_m: Nx3, where people are, frame: the one that tracks are in.

        Returns:
            Nx3x3, frame: the one that tracks are in; None if the camera has not moved.
        """
        pose = observation.map_from_camera
        if pose is None:
            return None
        before = self._poses.get(observation.camera)
        self._poses[observation.camera] = pose
        if before is None or np.array_equal(before, pose):
            return None
        way_m, turn_rad = displacement(invert(before) @ pose)
        away_m = places_m - pose[:3, 3]
        aside_m = np.stack([-away_m[:, 1], away_m[:, 0], np.zeros(len(away_m))], axis=-1)
        turned = (
            self._config.drift_rotation_rad**2 * turn_rad * aside_m[:, :, None] * aside_m[:, None]
        )
        return turned + self._config.drift_distance_m**2 * way_m * np.diag([1.0, 1.0, 0.0])

    def clear(self) -> None:
        """Forget where cameras were."""
        self._poses.clear()
