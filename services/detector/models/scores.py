"""Scores of detections as probabilities (docs/method.md section 21).

Each network's scores have another meaning: nearly all detections with MoveNet's 0.15 are people,
but every third with YOLOv8's 0.15. A calibrated score is the probability of a person, and one
threshold suits all models.
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
