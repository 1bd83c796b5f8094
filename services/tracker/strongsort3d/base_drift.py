"""Position uncertainty from the drift of the odometry of a moving base."""

import numpy as np

from common.geometry.planar_covariance import PlanarCovariance
from common.geometry.transform_history import displacement
from common.geometry.transforms import invert
from people4d.messages import F64
from services.tracker.interface import Observation
from services.tracker.motion.track_set import TrackSet
from services.tracker.strongsort3d.policies import TrackPolicy

DRIFT_DISTANCE_M = 0.02  # standard deviation of drift after a distance of 1 m [m]
DRIFT_ROTATION_RAD = 0.05  # standard deviation of drift after a rotation of 1 rad [rad]


class BaseDrift(TrackPolicy):
    """Covariance of tracked positions due to errors of the motion of the base.

    The covariance of the odometry is used if it grows. Otherwise errors of distance and angle are
    random walks in distance and angle. A rotation by an angle e about the vertical moves a person
    at distance r by e r, at right angles to the ray.
    """

    def __init__(self) -> None:
        self._poses: dict[str, F64] = {}
        self._bases: dict[str, PlanarCovariance | None] = {}

    def after_prediction(self, tracks: TrackSet, observation: Observation) -> None:
        """Add the drift since the camera's last frame to the tracks last matched by it."""
        covariances_m2 = self.since_last(observation, tracks.positions_m(tracks.records))
        if covariances_m2 is not None:
            tracks.add_covariance(covariances_m2, observation.camera)

    def since_last(self, observation: Observation, positions_m: F64) -> F64 | None:
        """Return the covariances (Nx3x3) of positions (Nx3) by the last motion of the camera.

        None if the camera has not moved.
        """
        pose = observation.map_from_camera
        if pose is None:
            return None
        before = self._poses.get(observation.camera)
        self._poses[observation.camera] = pose
        base_before = self._bases.get(observation.camera)
        base = self._bases[observation.camera] = observation.base
        if before is None or np.array_equal(before, pose):
            return None
        growth = base.growth(base_before) if base and base_before else None
        if base is not None and growth is not None:
            return carried(growth, positions_m[:, :2] - base.position_m)
        distance_m, rotation_rad = displacement(invert(before) @ pose)
        ray_m = positions_m - pose[:3, 3]
        aside_m = np.stack([-ray_m[:, 1], ray_m[:, 0], np.zeros(len(ray_m))], axis=-1)
        turn = DRIFT_ROTATION_RAD**2 * rotation_rad * aside_m[:, :, None] * aside_m[:, None]
        return turn + DRIFT_DISTANCE_M**2 * distance_m * np.diag([1.0, 1.0, 0.0])

    def clear(self) -> None:
        """Drop the poses of the cameras."""
        self._poses.clear()
        self._bases.clear()


def carried(covariance: F64, rays_m: F64) -> F64:
    """Return covariances (Nx3x3) of positions by the covariance of the pose of the base.

    Positions are at rays (Nx2) from the base: G = [1 0 -y; 0 1 x].
    """
    G = np.zeros((len(rays_m), 3, 3))
    G[:, 0, 0] = G[:, 1, 1] = 1.0
    G[:, 0, 2], G[:, 1, 2] = -rays_m[:, 1], rays_m[:, 0]
    result: F64 = G @ covariance @ G.swapaxes(1, 2)
    return result
