"""Likelihood policy: costs of round 1 as a likelihood (docs/method.md, section 5)."""

from people4d.messages import F64
from services.tracker.strongsort3d.policies import CostPolicy


class Likelihood(CostPolicy):
    """Weigh uncertain detections by ln |S|, and match only pairs that cost less than C_cos.

    Without ln |S| an uncertain detection appears nearer than a certain one. If the number of pairs
    is maximised, a lost track can take the detection of another person.
    """

    def added_cost(self, weight: float, log_det: F64) -> F64 | float:
        """Return lambda ln |S|."""
        return weight * log_det

    def unmatched_cost(self, c_cos: float) -> float:
        """Return C_cos."""
        return c_cos
