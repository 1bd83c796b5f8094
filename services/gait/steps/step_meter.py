"""Gait measures of one person over the last seconds."""

import math
from collections import deque
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from people4d.messages import F64, GaitMeasures
from services.gait.config import StepConfig
from services.gait.steps.steps import FootStep, find_steps, gait_measures
from services.gait.steps.swings import FEET, FootTrajectory, Side


class FootSample(NamedTuple):
    """Position of a foot in one frame, measured or predicted."""

    position_m: F64  # 3, fixed frame
    covariance_m2: F64  # 3x3


class StepMeter:
    """Computes the gait measures of one person over the last seconds; `up` as in `find_steps`."""

    def __init__(self, config: StepConfig, up: F64) -> None:
        self._config, self._up = config, up
        self._samples: dict[Side, deque[tuple[float, FootSample]]] = {f: deque() for f in FEET}
        self._due_s = -math.inf
        self._measures = GaitMeasures()

    def add_frame(
        self,
        stamp_s: float,
        left: FootSample | None,
        right: FootSample | None,
    ) -> GaitMeasures:
        """Add the feet of a frame and return the measures.

        Frames older than the last one are ignored.
        """
        for samples, one in zip(self._samples.values(), (left, right), strict=True):
            if one is not None and (not samples or samples[-1][0] < stamp_s):
                samples.append((stamp_s, one))
            while samples and samples[0][0] < stamp_s - self._config.window_s:
                samples.popleft()
        if stamp_s >= self._due_s:
            self._due_s = stamp_s + self._config.every_s
            self._measures = gait_measures(self.steps())
        return self._measures

    def steps(self) -> list[FootStep]:
        """Return the steps of the last seconds."""
        return find_steps(*self._trajectories(), self._up)

    def _trajectories(self) -> tuple[FootTrajectory, FootTrajectory]:
        left, right = (_trajectory(samples) for samples in self._samples.values())
        return left, right


def _trajectory(samples: Collection[tuple[float, FootSample]]) -> FootTrajectory:
    return FootTrajectory(
        np.array([time_s for time_s, _ in samples]),
        np.array([one.position_m for _, one in samples]).reshape(-1, 3),
        np.array([one.covariance_m2 for _, one in samples]).reshape(-1, 3, 3),
    )
