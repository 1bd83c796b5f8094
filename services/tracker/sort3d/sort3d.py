"""SORT-3D: boxes and 3D positions, one assignment (method book section 4)."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from common.geometry.boxes import iou_xyxy
from people4d.messages import F64, Track
from services.tracker import state
from services.tracker.config import TrackerConfig
from services.tracker.interface import Measurement, Need, Observation, in_order
from services.tracker.motion.motion import BoxMotion
from services.tracker.motion.population import Population, Survival, Target, stack
from services.tracker.motion.yaw import make_yaw
from services.tracker.sort3d import association


class Sort3d:
    """SORT with the 3D position in its state and cost.

    It compares boxes, so it serves one camera; people seen by several need StrongSORT-3D.
    A tentative track outlives a miss, but then needs its matches in a row anew, as in SORT.
    """

    needs: ClassVar[frozenset[Need]] = frozenset()

    def __init__(self, config: TrackerConfig) -> None:
        self._config = config.sort3d
        self._motion = BoxMotion(self._config)
        survival = Survival(
            confirm_hits=self._config.min_hits,
            tentative_frames=self._config.t_lost,
            lost_frames=self._config.t_lost,
            lost_s=config.max_lost_s,
        )
        self._people = Population(self._motion, survival, make_yaw(config))
        self.identities = self._people.identities
        self._tau_m = np.inf

    def update(self, observation: Observation) -> list[Track]:
        """Predict, assign, correct; begin and end tracks."""
        people = self._people
        people.advance(observation)
        detections = in_order(observation.measurements)
        cost = self._cost(people.targets, detections)
        matched, _, new = association.associate(cost, people.targets, detections)
        people.match(matched, observation)
        return people.finish(new, observation)

    def predict(self, stamp_ns: int) -> list[Track]:
        """Return the tracks as they should be at a later time."""
        return self._people.predicted(stamp_ns)

    def reset(self) -> None:
        """Forget all people and times, but not which identities were given."""
        self._people.clear()
        self._tau_m = np.inf

    def save(self) -> bytes:
        """Return all that is known of people."""
        return state.save("sort3d", self._people)

    def restore(self, saved: bytes) -> None:
        """Go on with what another process saved."""
        state.restore("sort3d", self._people, saved)

    def postpone(self, duration_ns: int) -> None:
        """Take a time as not passed, since nobody looked."""
        self._people.postpone(duration_ns)

    def _cost(self, targets: Sequence[Target], detections: Sequence[Measurement]) -> F64:
        """Return the cost with its gates, and set tau for the next frame."""
        config = self._config
        if not targets or not detections:
            self._tau_m = np.inf
            return np.full((len(targets), len(detections)), np.inf)
        x, _ = stack(targets)
        positions = np.array([m.position_m for m in detections])
        iou = iou_xyxy(self._motion.boxes(x), np.array([m.box_xyxy_px for m in detections]))
        d = association.distances(x[:, self._motion.position], positions)
        cost = combined_cost(iou, d, config.iou_weight)
        if config.iou_gate:
            cost[iou < config.iou_min] = np.inf
        if config.distance_gate:
            cost[d >= max(self._tau_m, config.distance_gate_floor_m)] = np.inf
        self._tau_m = association.adaptive_gate(d, config.distance_gate_sigmas)
        return cost


def combined_cost(iou: F64, d_m: F64, a: float) -> F64:
    """Return c = a (1 - IoU) + (1 - a) d_n, d_n the min-max normalised distance (section 4)."""
    cost: F64 = a * (1 - iou) + (1 - a) * association.min_max(d_m)
    return cost
