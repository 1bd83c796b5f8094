"""Metrics of tracking: one record of ground truth and hypotheses, and the scores on it.

`score(sequence, similarity)` gives all metrics of docs/method.md, section 9, for one sequence.
Scores hold counts and sums, so that `combine` pools sequences properly; ratios are taken at the
end. `live.scorer` scores messages as they come, with the same counts.
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
from common.metrics.alignment.truth_buffer import TruthBuffer
from common.metrics.clear import ClearCounts
from common.metrics.field_of_view import in_view
from common.metrics.frame_scores import IdSwitch, ScoreTotals
from common.metrics.from_messages import ground_truth_of, hypotheses_of
from common.metrics.hota import ALPHAS, HotaCounts
from common.metrics.identity import IdentityCounts
from common.metrics.lifetimes import Lifetimes, ReturnToView, find_returns
from common.metrics.matching import Matcher, Matching, PersonHistory, match
from common.metrics.pose import PoseErrors
from common.metrics.record import (
    EvaluationFrame,
    EvaluationSequence,
    FrameMatches,
    GroundTruth,
    Hypotheses,
    Id,
)
from common.metrics.scores import (
    Row,
    Scores,
    SummaryStatistics,
    combine,
    score,
    score_matching,
    summarise,
)
from common.metrics.similarity import GroundDistance, Similarity, box_overlap

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
    "ScoreTotals",
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
    "ground_truth_of",
    "hypotheses_of",
    "in_view",
    "match",
    "score",
    "score_matching",
    "summarise",
    "trajectories_of",
    "transform_truth",
]
