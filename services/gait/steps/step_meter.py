"""Gait measures of one person over the last seconds."""

import math
from collections import deque
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from people4d.messages import F64, GaitMeasures
from services.gait.config import StepConfig
from services.gait.steps.steps import FootStep, PointTrajectory, find_steps, gait_measures


class PointSample(NamedTuple):
    """Position of a point in one frame, measured or predicted."""

    position_m: F64  # 3, fixed frame
    covariance_m2: F64  # 3x3


class StepMeter:
    """Computes the gait measures of one person over the last seconds."""

    def __init__(self, config: StepConfig) -> None:
        self._config = config
        # samples of the body, the left foot and the right foot
        self._samples: tuple[deque[tuple[float, PointSample]], ...] = (deque(), deque(), deque())
        self._due_s = -math.inf
        self._measures = GaitMeasures()

    def add_frame(
        self,
        stamp_s: float,
        body: PointSample | None,
        left: PointSample | None,
        right: PointSample | None,
    ) -> GaitMeasures:
        """Add the body, by its head, and the feet of a frame and return the measures.

        Frames older than the last one are ignored.
        """
        for samples, one in zip(self._samples, (body, left, right), strict=True):
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
        body, left, right = map(_trajectory, self._samples)
        return find_steps(body, left, right)


def _trajectory(samples: Collection[tuple[float, PointSample]]) -> PointTrajectory:
    return PointTrajectory(
        np.array([time_s for time_s, _ in samples]),
        np.array([one.position_m for _, one in samples]).reshape(-1, 3),
        np.array([one.covariance_m2 for _, one in samples]).reshape(-1, 3, 3),
    )
