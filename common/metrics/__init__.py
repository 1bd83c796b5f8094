"""How good tracking is: one record of what was true and what was told, and the figures on it.

`score(sequence, similarity)` gives everything of method book section 9 for one sequence. Scores
hold counts and sums, so that `combine` pools sequences properly; ratios are taken at the end.
"""

from common.metrics.alignment.alignment import (
    ClockOffset,
    SpaceAlignment,
    estimate_clock,
    estimate_motion,
    fit_2d,
    fit_3d,
    transform_truth,
)
from common.metrics.alignment.trajectories import trajectories_of
from common.metrics.alignment.truth_buffer import TruthBuffer, interpolate
from common.metrics.clear import ClearCounts, IdSwitch, id_switches
from common.metrics.field_of_view import in_view
from common.metrics.hota import ALPHAS, HotaCounts
from common.metrics.identity import IdentityCounts
from common.metrics.lifetimes import Lifetimes
from common.metrics.matching import FrameMatches, Matcher, Matching, PersonHistory, match
from common.metrics.pose import PoseErrors
from common.metrics.record import EvaluationFrame, EvaluationSequence, GroundTruth, Hypotheses, Id
from common.metrics.returns import ReturnToView, find_returns
from common.metrics.scores import Row, Scores, combine, score, score_matching
from common.metrics.similarity import GroundDistance, Similarity, box_overlap
from common.metrics.summary import SummaryStatistics, summarise

__all__ = [
    "ALPHAS",
    "ClearCounts",
    "ClockOffset",
    "EvaluationFrame",
    "EvaluationSequence",
    "FrameMatches",
    "GroundDistance",
    "GroundTruth",
    "HotaCounts",
    "Hypotheses",
    "Id",
    "IdSwitch",
    "IdentityCounts",
    "Lifetimes",
    "Matcher",
    "Matching",
    "PersonHistory",
    "PoseErrors",
    "ReturnToView",
    "Row",
    "Scores",
    "Similarity",
    "SpaceAlignment",
    "SummaryStatistics",
    "TruthBuffer",
    "box_overlap",
    "combine",
    "estimate_clock",
    "estimate_motion",
    "find_returns",
    "fit_2d",
    "fit_3d",
    "id_switches",
    "in_view",
    "interpolate",
    "match",
    "score",
    "score_matching",
    "summarise",
    "trajectories_of",
    "transform_truth",
]
