"""SORT-3D: boxes and 3D positions, one assignment (docs/method.md, section 4 [PIC4SeR])."""

from collections.abc import Sequence

import numpy as np

from common.geometry.boxes import iou_xyxy
from people4d.messages import F64, Track
from services.tracker.config import TrackerConfig
from services.tracker.interface import Measurement, Observation, in_order
from services.tracker.motion.lifecycle import Lifecycle
from services.tracker.motion.track_record import TrackRecord, stack
from services.tracker.motion.track_set import TrackSet
from services.tracker.motion.yaw_sources import make_yaw
from services.tracker.sort3d import association
from services.tracker.sort3d.box_motion import BoxMotion
from services.tracker.stateful import TrackSetTracker

IOU_WEIGHT = 0.3  # weight a in c = a (1 - IoU) + (1 - a) d_n; section 4
IOU_MIN = 0.3  # minimum intersection over union of a pair; section 4 (default)


class Sort3d(TrackSetTracker):
    """SORT with the 3D position in its state and cost.

    Boxes are compared, which requires a single camera. A tentative track survives a miss, but
    restarts its count of consecutive matches, as in SORT.
    """

    def __init__(self, config: TrackerConfig) -> None:
        self._config = config.sort3d
        self._motion = BoxMotion()
        lifecycle = Lifecycle(
            confirm_hits=self._config.min_hits,
            tentative_frames=self._config.t_lost,
            lost_frames=self._config.t_lost,
            lost_s=config.max_lost_s,
        )
        yaw = make_yaw(config.yaw, config.yaw_speed_min_mps)
        super().__init__(TrackSet(self._motion, lifecycle, yaw))
        self._tau_m = np.inf

    def update(self, observation: Observation) -> list[Track]:
        """Predict, associate, update, and manage the life of the tracks."""
        tracks, detections = self.tracks, in_order(observation.measurements)
        tracks.predict(observation)
        cost = self._cost(tracks.records, detections)
        result = association.associate(cost, tracks.records, detections)
        tracks.update(result.matches, observation)
        return tracks.manage(result.unmatched_detections, observation)

    def reset(self) -> None:
        """Delete all tracks and times; identities are not reused."""
        super().reset()
        self._tau_m = np.inf

    def _cost(self, records: Sequence[TrackRecord], detections: Sequence[Measurement]) -> F64:
        """Return the gated cost, and set tau for the next frame."""
        if not records or not detections:
            self._tau_m = np.inf
            return np.full((len(records), len(detections)), np.inf)
        x, _ = stack(records)
        positions_m = np.array([m.position_m for m in detections])
        iou = iou_xyxy(self._motion.boxes(x), np.array([m.box_xyxy_px for m in detections]))
        d_m = association.distances(x[:, self._motion.position], positions_m)
        cost = combined_cost(iou, d_m)
        cost[iou < IOU_MIN] = np.inf
        cost[d_m >= max(self._tau_m, self._config.distance_gate_floor_m)] = np.inf
        self._tau_m = association.adaptive_gate(d_m)
        return cost


def combined_cost(iou: F64, d_m: F64, a: float = IOU_WEIGHT) -> F64:
    """Return c = a (1 - IoU) + (1 - a) d_n, d_n the min-max normalised distance."""
    cost: F64 = a * (1 - iou) + (1 - a) * association.min_max(d_m)
    return cost
