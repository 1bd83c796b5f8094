"""Scores of detections as probabilities (docs/method.md section 21).

Scores of networks differ: at 0.15, nearly all detections of MoveNet are people, but only a third of
YOLOv8's. A calibrated score is the probability of a person, so one threshold suits all models.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from people4d.messages import F64


@dataclass(frozen=True)
class ScoreCalibration:
    """Logistic function of the logarithm of a score."""

    midpoint: float  # score at which half of the detections are people
    slope: float  # > 0, steepness

    def probability(self, scores: npt.ArrayLike) -> F64:
        """Return the probability that detections of scores (0 to 1) are people."""
        with np.errstate(divide="ignore", over="ignore"):
            odds_against = (self.midpoint / np.asarray(scores, np.float64)) ** self.slope
        probability: F64 = 1.0 / (1.0 + odds_against)
        return probability
