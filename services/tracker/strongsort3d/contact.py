"""Contact policy: association of people who touch or cross."""

import numpy as np

from people4d.messages import F64
from services.tracker.motion.track_record import TrackRecord
from services.tracker.strongsort3d.config import ContactConfig
from services.tracker.strongsort3d.policies import ContactPolicy, FrameContext


class Contact(ContactPolicy):
    """Wide gates for covered people, and embeddings that settle fast."""

    def __init__(self, config: ContactConfig) -> None:
        self._config = config

    def gate_covariances_m2(self, frame: FrameContext) -> F64 | None:
        """Return covariances (Mx3x3) along the rays to detections that others cover, if any.

        The depth of a half hidden person is often that of the person in front. A match counts in
        full nevertheless: a track that is kept from its measurement ends beside its person.
        """
        pose = frame.observation.map_from_camera
        if pose is None or not frame.depth_uncertain:
            return None
        rays = frame.positions_m - pose[:3, 3]
        rays /= np.maximum(np.linalg.norm(rays, axis=1), 1e-6)[:, None]
        covered = np.array([m.index in frame.depth_uncertain for m in frame.detections])
        sigmas_m = np.where(covered, self._config.depth_sigma_m, 0.0)
        return np.asarray(sigmas_m[:, None, None] ** 2 * rays[:, :, None] * rays[:, None])

    def alpha(self, alpha: float, record: TrackRecord) -> float:
        """Return alpha, or less so that the first embeddings of a track weigh the same."""
        return min(alpha, 1.0 - 1.0 / record.hits)
